"""Define the contract of a block, the interfaces of the roles, and units."""
