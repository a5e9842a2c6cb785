"""Pictures that pages make when the site is built."""

import page_pictures
import pytest

PAGE = """A page.

```yaml title="MOTION"
time: {start: 0, stop: 1, count: 3}
joints: {joint1: {offset: 1}, joint2: {offset: 1}}
```

```python
>>> from pathlib import Path
>>> 1 / 0
Traceback (most recent call last):
    ...
ZeroDivisionError: division by zero
>>> for name in ("a.png", "b.svg", "c.csv"):
...     _ = Path(name).write_bytes(name.encode())

```

```console
$ jounce run planar2r \\
    MOTION -o forces.csv
```
"""


def test_a_page_leaves_its_pictures():
    assert page_pictures.made_by(PAGE.replace("MOTION", "motion.yaml")) == {"a.png": b"a.png", "b.svg": b"b.svg"}


def test_a_command_that_fails_stops_the_build():
    with pytest.raises(RuntimeError, match="unknown motion 'MOTION'"):
        page_pictures.made_by(PAGE)


def test_pages_with_pictures_exist():
    assert all((page_pictures.DOCS / page).is_file() for page in page_pictures.PAGES)
