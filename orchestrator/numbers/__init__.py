"""From series to numbers and their texts: measures, derived quantities, statistics."""
