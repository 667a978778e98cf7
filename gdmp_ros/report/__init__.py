"""One page about a bag: what was streamed, how the arm followed, what happened."""
