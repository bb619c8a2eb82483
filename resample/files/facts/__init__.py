"""What picture files tell besides their pixels."""
