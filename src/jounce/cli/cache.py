"""`jounce cache`: the compiled kernels that are kept on disk."""

import click

from jounce.cli.output import tell

EPILOG = """\b
Example:
  jounce cache
  jounce cache --clear

\b
Kernels that are missing are compiled again. JOUNCE_CACHE_DIR in the
environment names another folder, JOUNCE_CACHE_SIZE the MiB that all kernels
together may take, 256 if it is not set: the least recently used are removed
first.
"""


@click.command(epilog=EPILOG, short_help="The compiled kernels on disk.")
@click.option("--clear", is_flag=True, help="Remove them; other files in the folder stay.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def cache(clear: bool, as_json: bool) -> None:
    """Show where compiled kernels are kept, how many and how large they are; or remove them."""
    from jounce.native import cache as kernels

    sizes = kernels.clear() if clear else [path.stat().st_size for path in kernels.entries()]
    summary = {
        "folder": str(kernels.folder()),
        "private": kernels.private(),
        "cleared": clear,
        "kernels": len(sizes),
        "bytes": sum(sizes),
        "limit": kernels.limit(),
    }
    tell(summary, _in_words, as_json)


def _in_words(summary: dict[str, object]) -> str:
    found = f"kernels {'removed' if summary['cleared'] else 'kept'}: {summary['kernels']}, {summary['bytes']} bytes"
    found += "" if summary["cleared"] else f" of at most {summary['limit']}"
    unused = "" if summary["private"] else "\nnot used: the folder is not yours alone"
    return f"{summary['folder']}\n{found}{unused}"
