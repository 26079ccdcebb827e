"""The study `law replay`: the samples of a recording, fed to another law."""
