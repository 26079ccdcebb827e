"""The laws that come with hertzloop, one file each; the file's name is the law's."""
