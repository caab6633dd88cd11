"""The paper's noisy squares: its tables again, and which of the assumptions that it leaves open fit them."""
