"""What an engineer wants to know before he leaves the node alone: tried, and measured."""
