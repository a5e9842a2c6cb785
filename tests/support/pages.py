"""What the tests of reports share: a page and its data, read back."""

import json
from base64 import b64decode

import numpy as np
from lxml import html

LARGEST = 8e6  # bytes


def parsed(report):
    """The page, and what its scripts read, by name."""
    page = html.document_fromstring(report.html)
    data = page.xpath("//script[@type='application/json']")
    return page, {script.get("id").removesuffix("-data"): json.loads(script.text) for script in data}


def decoded(packed):
    return np.frombuffer(b64decode(packed["bdata"]), dtype="<" + packed["dtype"])


def drawn_traces(data):
    """The curves of a page: those of the forces, and those in the fold."""
    return [trace for panel in ("curves", "rates") for trace in data[panel]["data"]]


def words(page, path):
    [found] = page.xpath(path)
    return " ".join(found.text_content().split())


def panel(name):
    return f"//section[@id='{name}-panel']"
