"""The command line and its demo: runs, figures and tables for people."""
