"""What several blocks of a role share."""
