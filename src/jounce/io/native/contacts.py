"""The contacts of a robot file, one entry each with the fields of `jounce.Contact`.

contacts:
  - {frame: left_foot, kind: plane, place: [0.035, 0, -0.037], sole: [0.09, 0.03], friction: 0.6}
"""

from dataclasses import fields

import numpy as np

from jounce.arguments.contacts import with_contacts
from jounce.core.errors import locate_errors
from jounce.core.typing import JsonObject
from jounce.io.entries import Entry
from jounce.model.contacts import Contact
from jounce.model.mechanism import Mechanism

CONTACTS_SECTION = "contacts"
_FIELDS = [field.name for field in fields(Contact)]  # frame and kind, which an entry needs, and others


def read(robot: Entry, mechanism: Mechanism) -> Mechanism:
    """The mechanism on the contacts of a file."""
    contacts = []
    for entry in robot.get(CONTACTS_SECTION, []).items():
        with locate_errors(entry.keys(_FIELDS[:2], _FIELDS[2:]).place):
            contacts.append(Contact(**entry.value))
    with locate_errors(robot.get(CONTACTS_SECTION).place):
        return with_contacts(mechanism, contacts) if contacts else mechanism


def write_section(mechanism: Mechanism) -> JsonObject:
    """What a file states of the contacts of a mechanism."""
    return {CONTACTS_SECTION: [*map(_contact_data, mechanism.contacts)]} if mechanism.contacts else {}


def _contact_data(contact: Contact) -> JsonObject:
    """The fields that are stated: a place that is not turned as a point, and weights that are not the default ones."""
    stated = {name: getattr(contact, name) for name in _FIELDS}
    if (contact.place[:3, :3] == np.eye(3)).all():
        stated["place"] = contact.place[:3, 3]
    if (stated["weights"] == Contact(contact.frame, contact.kind, sole=contact.sole).weights).all():
        del stated["weights"]
    return {name: np.asarray(x).tolist() for name, x in stated.items() if x is not None}
