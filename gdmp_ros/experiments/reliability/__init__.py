"""What happens when something goes wrong: faults, load and bad networks, tried on processes."""
