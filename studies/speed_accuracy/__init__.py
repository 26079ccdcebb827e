"""Speed against accuracy: every scheme on the same equations."""
