"""A paper's tables and pages: our numbers beside the paper's, stored draws, templates."""
