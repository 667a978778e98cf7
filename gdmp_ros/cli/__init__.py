"""The command ``gdmp``: one file per verb."""
