"""A biped in the manner of Cassie: rods on balls that close loops, springs at shins and heels, a pelvis that floats."""

import re

LEG = """
<body name='{s}-hip' pos='.02 {y} 0' xyaxes='0 0 -1 0 1 0'>
 <inertial pos='-.02 0 -.05' mass='2' fullinertia='.004 .004 .002 0 -.0008 0'/><joint name='{s}-hip' damping='1'/>
 <body name='{s}-thigh' pos='0 0 -.08' quat='.5 .5 .5 .5'>
  <inertial pos='.06 0 -.03' mass='5' fullinertia='.011 .03 .031 -.0003 0 0'/>
  <joint name='{s}-thigh' armature='.09' damping='1'/>
  <body name='{s}-achilles-rod' pos='0 0 .04' xyaxes='.8 -.6 0 .6 .8 0'>
   <inertial pos='.25 0 0' mass='.2' diaginertia='1e-5 .004 .004'/>
   <joint name='{s}-achilles-rod' type='ball' damping='.01'/>
  </body>
  <body name='{s}-knee' pos='.13 0 0' euler='0 0 -45'>
   <inertial pos='.02 .03 0' mass='.8' fullinertia='.0014 .001 .0022 -.0004 0 0'/>
   <joint name='{s}-knee' ref='-40' armature='.09' damping='1'/>
   <body name='{s}-shin' pos='.06 .05 0'>
    <inertial pos='.18 0 0' mass='.6' diaginertia='.0004 .015 .015'/>
    <joint name='{s}-shin' stiffness='1500' damping='.1'/>
    <body name='{s}-tarsus' pos='.43 .02 0' euler='0 0 60'>
     <inertial pos='.1 -.03 0' mass='.8' fullinertia='.0004 .014 .014 .0002 0 0'/>
     <joint name='{s}-tarsus' ref='55' damping='.1'/>
     <body name='{s}-heel' pos='-.01 -.03 0' euler='0 0 155'>
      <inertial pos='.08 0 0' mass='.1' diaginertia='3e-5 .0002 .0002'/><joint name='{s}-heel' stiffness='1250'/>
     </body>
     <body name='{s}-crank' pos='.06 -.03 .02'>
      <inertial pos='.005 0 0' mass='.1' diaginertia='3e-5 5e-5 6e-5'/><joint name='{s}-crank'/>
      <body name='{s}-plantar-rod' pos='.05 0 0'>
       <inertial pos='.18 0 0' mass='.1' diaginertia='1e-5 .002 .002'/>
       <joint name='{s}-plantar-rod' type='ball' pos='.01 0 .005'/>
      </body>
     </body>
     <body name='{s}-foot' pos='.4 -.04 0'>
      <inertial pos='.005 .03 0' mass='.15' diaginertia='.0002 .0002 .0003'/><joint name='{s}-foot' armature='.01'/>
     </body>
    </body>
   </body>
  </body>
 </body>
</body>"""
TIES = "<connect body1='{s}-plantar-rod' body2='{s}-foot' anchor='.35 0 0'/>" + (
    "<connect body1='{s}-achilles-rod' body2='{s}-heel' anchor='.5 0 0'/>"
)
MOTORS = "".join(f"<motor joint='{{s}}-{joint}' gear='16'/>" for joint in ("hip", "thigh", "knee", "foot"))


def both(text):
    return text.format(s="left", y=".13") + text.format(s="right", y="-.13")


BIPED = f"""<mujoco model='biped'><worldbody><body name='pelvis' pos='0 0 1.1'><freejoint/>
<inertial pos='.05 0 .03' mass='10' fullinertia='.09 .05 .09 0 -.0002 -.0004'/><site name='imu' pos='.03 0 -.08'/>
{both(LEG)}</body></worldbody><equality>{both(TIES)}</equality><actuator>{both(MOTORS)}</actuator></mujoco>"""


def _turns(ball):
    """Three hinges in place of a ball, or of the turns of the free joint."""
    name, pos = (found[1] if (found := re.search(f"{key}='([^']*)'", ball[0])) else "" for key in ("name", "pos"))
    at = f" pos='{pos}'" if pos else ""
    axes = {"yaw": "0 0 1", "pitch": "0 1 0", "roll": "1 0 0"}
    return "".join(f"<joint name='{name or 'base'}_{turn}' axis='{axis}'{at}/>" for turn, axis in axes.items())


def biped_of_hinges(ties=""):
    """The same biped with hinges and slides in place of balls and of the free joint, and more equality constraints."""
    slides = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
    base = "".join(f"<joint name='base_{x}' type='slide' axis='{axis}'/>" for x, axis in slides.items())
    text = re.sub("<joint [^>]*type='ball'[^>]*>", _turns, BIPED)
    text = text.replace("<freejoint/>", base + _turns(("",))).replace("pos='0 0 1.1'", "pos='0 0 0'")
    return text.replace("</equality>", f"{ties}</equality>")
