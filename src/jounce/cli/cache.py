"""`jounce cache`: the compiled kernels that are kept on disk."""

import click

from jounce.cli.output import print_summary

EPILOG = """\b
Example:
  jounce cache
  jounce cache --clear

\b
Missing kernels are recompiled. The environment variable JOUNCE_CACHE_DIR
selects another folder; JOUNCE_CACHE_SIZE limits the size of all kernels in
MiB (default: 256): the least recently used are removed first.
"""


@click.command(epilog=EPILOG, short_help="Show or clear the compiled kernels on disk.")
@click.option("--clear", is_flag=True, help="Remove all kernels; other files in the folder are kept.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def cache(clear: bool, as_json: bool) -> None:
    """Show the folder, number and size of the compiled kernels, or remove them."""
    from jounce.native import cache as kernels

    sizes = kernels.clear() if clear else [path.stat().st_size for path in kernels.kernel_paths()]
    summary = {
        "folder": str(kernels.folder()), "private": kernels.folder_obstacle() is None, "obstacle": kernels.obstacle(),
        "cleared": clear, "kernels": len(sizes), "bytes": sum(sizes), "limit": kernels.size_limit(),
    }  # fmt: skip
    print_summary(summary, _format_summary, as_json)


def _format_summary(summary: dict[str, object]) -> str:
    found = f"kernels {'removed' if summary['cleared'] else 'kept'}: {summary['kernels']}, {summary['bytes']} bytes"
    found += "" if summary["cleared"] else f" of at most {summary['limit']}"
    unused = f"\nnot used: {summary['obstacle']}" if summary["obstacle"] else ""
    return f"{summary['folder']}\n{found}{unused}"
