"""What several test modules share: scenes, random shapes, places in the repository, a browser. No test stands here."""
