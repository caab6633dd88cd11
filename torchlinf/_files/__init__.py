"""Files of masks in, files of rows out: what is read, how it is found, and how tables stay whole."""
