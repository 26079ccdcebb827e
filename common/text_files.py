"""Text of files that people bring, in the encodings that editors write."""

import codecs
import importlib.util
import re

_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)  # the marks
_CODING = re.compile(r"^([ \t\f]*#.*?coding[:=][ \t]*)[-\w.]+")


def text_of(content: bytes) -> str:
    """Return a file's text with line feeds at the ends of its lines.

    Args:
        content: The file, in UTF-8 with or without a mark, or in UTF-16 with a mark.

    Raises:
        ValueError: the encoding is another one.
    """
    encoding = "utf-16" if content.startswith(_UTF_16) else "utf-8-sig"
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError as error:
        if b"\0" not in content or encoding == "utf-16":
            raise ValueError(_not_in(encoding, content, error)) from error
        text = "\0"
    if "\0" in text:
        raise ValueError(
            "its text has null bytes, as UTF-32 has, and UTF-16 without a mark. Save the file as "
            "UTF-8"
        )
    return text.replace("\r\n", "\n").replace("\r", "\n")


def python_text(content: bytes) -> str:
    """Return the text of a Python file in the encoding that its mark or its coding line names. The
    coding line of the text names UTF-8, in which it is sent and recorded.

    Raises:
        ValueError: the text is not in this encoding, or Python does not know it.
    """
    if content.startswith(_UTF_16):
        raise ValueError(
            "its text is in UTF-16, which Python does not read. Save the file as UTF-8"
        )
    try:
        text = importlib.util.decode_source(content)
    except SyntaxError as error:  # of the first two lines
        text_of(content)
        raise ValueError(f"{error}. Name the encoding of the file in its coding line") from error
    except UnicodeDecodeError as error:
        raise ValueError(_not_in(error.encoding, content, error)) from error
    lines = text.split("\n", 2)
    return "\n".join([_CODING.sub(r"\1utf-8", line) for line in lines[:2]] + lines[2:])


def _not_in(encoding: str, content: bytes, error: UnicodeDecodeError) -> str:
    name = encoding.upper().removesuffix("-SIG")
    if name != "UTF-8":
        return f"its text is not in {name}: {error.reason}. Save the file as UTF-8"
    at = error.start + (len(codecs.BOM_UTF8) if content.startswith(codecs.BOM_UTF8) else 0)
    line = content.count(b"\n", 0, at) + 1
    return (
        f"its text is not in UTF-8: byte 0x{content[at]:02x} in line {line}, perhaps of Latin-1 or "
        "Windows-1252. Save the file as UTF-8"
    )
