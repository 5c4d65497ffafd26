"""Write what a user begins with: a craft's folder, a block's file."""
