"""Mathematics that knows no spacecraft."""
