"""What is examined after the estimates: published numbers, conventions, tests of equality."""
