"""What people look at and measure with: pictures of results, and later studies of speed and accuracy."""
