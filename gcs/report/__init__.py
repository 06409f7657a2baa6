"""What a recorded flight came to."""
