"""Studies: each measures one thing on this machine and gives a table, a figure and a JSON file."""
