"""`jounce cache`: the compiled kernels that are kept on disk."""

import click

from jounce.cli.output import print_result

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
    folder, obstacle = str(kernels.folder()), kernels.obstacle()

    def data() -> dict[str, object]:
        return {
            "folder": folder, "private": kernels.folder_obstacle() is None, "obstacle": obstacle,
            "cleared": clear, "kernels": len(sizes), "bytes": sum(sizes), "limit": kernels.size_limit(),
        }  # fmt: skip

    def lines() -> list[str]:
        most = "" if clear else f" of at most {kernels.size_limit()}"
        found = f"kernels {'removed' if clear else 'kept'}: {len(sizes)}, {sum(sizes)} bytes{most}"
        return [folder, found, *([f"not used: {obstacle}"] if obstacle else [])]

    print_result(lines, data, as_json)
