"""`jounce codegen` and `cache`: source code of a robot's equations, and compiled kernels on disk."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from jounce.cli.commands import Command, split_names
from jounce.cli.output import print_result
from jounce.cli.robot_options import PATH, RobotRequest, add_robot_options
from jounce.core.errors import JounceError

if TYPE_CHECKING:
    from jounce.core.typing import JsonObject, Language


CODEGEN_EPILOG = """\b
Example:
  jounce codegen iiwa14 --lang c --order 2 -o iiwa14-c
  make -C iiwa14-c test

\b
Quantities for --outputs: jounce help quantities.

\b
Names for --parameters: gravity, masses, lengths, payload, payload:BODY and,
  for elastic joints, stiffness and rotor.
"""


@click.command(cls=Command, epilog=CODEGEN_EPILOG, short_help="Generate source code in another language, with tests.")
@add_robot_options
@click.option(
    "--lang", required=True, help="Language: c, casadi, cpp, cuda, javascript, julia, latex, matlab, python or rust."
)
@click.option("--order", default=2, help="Highest time derivative, up to 4: 2 gives Q, Qd, Q2d.")
@click.option("-o", "--output", required=True, type=PATH, help="Output folder, new or empty.")
@click.option(
    "--outputs",
    multiple=True,
    callback=split_names,
    metavar="NAMES",
    help="Comma-separated quantities to compute: NAME, NAME:BODY or NAME:BODY:FRAME; default: the forces Q.",
)
@click.option(
    "--wrench", is_flag=True, help="Add the wrenches on the bodies to the inputs of the quantities that depend on them."
)
@click.option(
    "--moving-base",
    is_flag=True,
    help="Add the motion of the base to the inputs, so that a fixed robot can stand on moving ground.",
)
@click.option(
    "--parameters",
    multiple=True,
    callback=split_names,
    metavar="NAMES",
    help="Comma-separated data of the robot that become inputs at run time.",
)
@click.option("--live", is_flag=True, help="Add the estimator of rates from encoders, in C or C++; its options follow.")
@click.option("--dt", type=float, metavar="S", help="Time between samples.")
@click.option("--bandwidth", type=float, metavar="HZ", help="Bandwidth of the motion.")
@click.option("--noise", type=float, metavar="RAD", help="Standard deviation of samples: 0.29 steps of an encoder.")
@click.option("--lag", type=float, metavar="S", help="Delay of the rates relative to the samples; default: 0.02.")
@click.option("--states", type=int, metavar="M", help="Order of the filter, 5 to 8; default: 6.")
@click.option("--float32", is_flag=True, help="Generate code in single precision.")
@click.option("--prefix", help="Prefix of all names in the code; default: the robot's name.")
@click.option("--overwrite", is_flag=True, help="Replace the files of an earlier run; other files stay.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def codegen(robot: RobotRequest, lang: "Language", order: int, output: Path, as_json: bool, **options: Any) -> None:
    """Generate source code, with tests, of the equations of ROBOT.

    ROBOT is a file or the name of a bundled robot.
    """
    # Options that are left out keep the defaults of `Robot.codegen`.
    arguments = {name: value for name, value in options.items() if value not in (None, ())}
    arm, live = robot.load(), arguments.pop("live")
    settings = {
        name: arguments.pop(name) for name in ("dt", "bandwidth", "noise", "lag", "states") if name in arguments
    }
    # The estimator needs these settings, and settings are of no use without it.
    is_complete = live and {"dt", "bandwidth", "noise"} <= settings.keys()
    if (live or len(settings) > 0) and not is_complete:
        names = ["live", *settings] if live else list(settings)
        given_options = ", ".join(f"--{name}" for name in names)
        raise JounceError(f"expected --live, --dt, --bandwidth and --noise together; got {given_options}")
    if live:
        arguments["live"] = arm.live(**settings)
    generated = arm.codegen(lang, order, output, **arguments)

    def data() -> "JsonObject":
        return {
            "robot": str(robot.path), "language": lang, "order": order, "output": str(generated.directory),
            "files": list(generated.files), "operations": generated.operations,
        }  # fmt: skip

    def lines() -> list[str]:
        counts = [f"{name}: {count} operations" for name, count in generated.operations.items()]
        return [*counts, f"{', '.join(generated.files)} written to {generated.directory}"]

    print_result(lines, data, as_json)


CACHE_EPILOG = """\b
Example:
  jounce cache
  jounce cache --clear

\b
Missing kernels are recompiled. The environment variable JOUNCE_CACHE_DIR
selects another folder. JOUNCE_CACHE_SIZE limits the size of all kernels in
MiB (default: 256); the least recently used kernels are removed first.
"""


@click.command(cls=Command, epilog=CACHE_EPILOG, short_help="Show or clear the compiled kernels on disk.")
@click.option("--clear", is_flag=True, help="Remove all kernels; other files in the folder are kept.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON.")
def cache(clear: bool, as_json: bool) -> None:
    """Show the folder and size of the compiled kernels, or remove them."""
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
        line = f"kernels {'removed' if clear else 'kept'}: {len(sizes)}, {sum(sizes)} bytes{most}"
        return [folder, line, *([f"not used: {obstacle}"] if obstacle else [])]

    print_result(lines, data, as_json)
