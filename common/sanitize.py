"""Text of others, made safe to print: a recording or another process may say anything."""

import re

# Of Unicode: control characters (C0 without tab and line feed, C1), format characters (those that
# change the direction of writing included), separators of lines and surrogates.
_UNSAFE = re.compile(
    "[\x00-\x08\x0b-\x1f\x7f-\x9f\xad\u061c\u180e\u200b-\u200f\u2028-\u202e\u2060-\u206f\ud800-\udfff"
    "\ufeff\ufff9-\ufffb\U000e0000-\U000e007f]"
)


def visible(text: str) -> str:
    """The text with an escape such as \\x1b in the place of each character that controls a
    terminal or hides."""
    return _UNSAFE.sub(lambda found: ascii(found[0])[1:-1], text)
