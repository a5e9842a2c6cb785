"""What the tests of files share: URDF text."""

MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
BODY = (2.0, [0.1, -0.2, 0.05], [0.3, 0.4, -0.2], [0.02, 0.001, -0.002, 0.03, 0.003, 0.025])  # mass, COM, rpy, moments
OTHER = (0.7, [-0.3, 0.02, 0.4], [1.1, -0.6, 2.5], [0.004, 0.0, 0.001, 0.006, -0.0005, 0.005])
ODD = (1.0, [0, 0, 0], [0, 0, 0], [1.0, 0.0, 0.0, 1.0, 0.0, 2.5])  # breaks the triangle inequality by 0.5


def text(numbers):
    return " ".join(repr(float(x)) for x in numbers)


def origin(xyz=(0, 0, 0), rpy=(0, 0, 0)):
    return f'<origin xyz="{text(xyz)}" rpy="{text(rpy)}"/>'


def link(name, body=None, inner=""):
    if body:
        mass, xyz, rpy, moments = body
        given = " ".join(f'{key}="{value!r}"' for key, value in zip(MOMENTS, moments, strict=True))
        inner += f'<inertial>{origin(xyz, rpy)}<mass value="{mass!r}"/><inertia {given}/></inertial>'
    return f'<link name="{name}">{inner}</link>'


def joint(name, parent, child, kind="revolute", axis="0 0 1", inner=""):
    inner += f'<axis xyz="{axis}"/>' if axis and kind != "fixed" else ""
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inner}</joint>'


LINKS = (link("base"), link("arm", BODY))  # lines 2 and 3 of a file
GOOD = (*LINKS, joint("turn", "base", "arm"))  # and line 4


def robot_file(folder, *items, head='<robot name="r">', name="robot.urdf"):
    """A URDF file, one item a line, from line 2 on."""
    path = folder / name
    path.write_text("\n".join([head, *items, "</robot>"]), encoding="utf-8")
    return path
