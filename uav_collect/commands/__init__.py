"""What a user starts from a shell: arguments in, core called, result shown or written."""
