"""Present runs to people and other programs: report, export, data sets."""
