"""What commands say to a user, and what they take colors by."""
