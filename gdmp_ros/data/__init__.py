"""Files: bags, recordings, recorded runs, exchange formats, data sets."""
