"""Which gradient regularises: designs compared on families of shapes and in training."""
