"""What one family's page and tables compute of its runs."""
