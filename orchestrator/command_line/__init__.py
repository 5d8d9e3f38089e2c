"""The command line. Nothing heavy is imported before it is needed: `gauntlet --help` answers at once."""
