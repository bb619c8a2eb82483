"""Browser page that previews what a command would paint while its options change."""
