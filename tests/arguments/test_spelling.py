"""Texts that ask for quantities, NAME[.PRODUCT][:BODY[:FRAME]]: read as they are written, and refused in one line."""

from dataclasses import replace

import pytest

from jounce.arguments import requests
from jounce.dynamics.quantities import QUANTITIES
from support.quantities import IDS, REQUESTS, branched
from support.refusals import expect_refusal, refusal

MECHANISM = branched().mechanism
ODD = replace(MECHANISM, bodies=("body1", "base:joint", "body1:world", "world", "base:joint:spatial"))


@pytest.mark.parametrize(("quantity", "keywords"), REQUESTS, ids=IDS)
def test_what_is_spelled_is_read(quantity, keywords):
    for product in (None, "vjp"):
        request = requests.ComputationRequest(quantity.name, quantity.highest(2), **keywords, product=product)
        asked = requests.build_computation(MECHANISM, request)
        assert requests.parse_computation(MECHANISM, asked.spelling, 2) == asked


@pytest.mark.parametrize("body", [None, *ODD.frame_names])
@pytest.mark.parametrize("quantity", [row for row in QUANTITIES.values() if row.of_bodies], ids=lambda row: row.name)
def test_names_of_bodies_may_hold_colons_and_be_those_of_frames(quantity, body):
    for frame in quantity.gives.frames or ("body",):
        request = requests.ComputationRequest(quantity.name, 1, body=body, frame=frame)
        asked = requests.build_computation(ODD, request)
        assert requests.parse_computation(ODD, asked.spelling, 1) == asked


def test_the_end_is_a_frame_where_the_rest_is_a_body():
    def read(text):
        asked = requests.parse_computation(ODD, text, 0)
        return asked.body, asked.frame

    assert read("jacobian") == (None, "body")
    assert read("jacobian:base:joint") == ("base:joint", "body")
    assert read("jacobian:base:joint:world") == ("base:joint", "world")
    assert read("jacobian:body1:world") == ("body1", "world")
    assert read("jacobian:body1:world:body") == ("body1:world", "body")
    assert read("jacobian:base:joint:spatial") == ("base:joint", "spatial")
    assert read("jacobian:world") == ("world", "body")
    assert read("jacobian::world") == (None, "world")
    assert read("poses:body1:world") == ("body1:world", "body")


@pytest.mark.parametrize(("text", "words"), [
    ("massmatrix", ["unknown quantity 'massmatrix'; did you mean 'mass_matrix'? available: inverse_dynamics, "]),
    ("", ["unknown quantity ''; available: inverse_dynamics, "]),
    (["mass_matrix"], ["unknown quantity ['mass_matrix']; available: "]),
    (None, ["unknown quantity None; available: "]),
    ("momentum:body1", ["momentum takes no body; these do: poses, twists, jacobian"]),
    ("momentum:body1:world", ["momentum takes no body"]),
    ("poses:bdy3", ["unknown body 'bdy3'; did you mean 'body3'? available: body1, ", "tool"]),
    ("poses:", ["unknown body ''; available: body1, "]),
    ("jacobian:too:world", ["unknown body 'too'; did you mean 'tool'? available: body1, "]),
    ("jacobian:tool:wrld", ["jacobian has no frame 'wrld'; did you mean 'world'? available: body, world, spatial"]),
    ("jacobian:tool:", ["jacobian has no frame ''; available: body, world, spatial"]),
    ("poses:tool:world", ["poses has no frame 'world'; available: none"]),
])  # fmt: skip
def test_refusals(text, words):
    refusal(lambda: requests.parse_computation(MECHANISM, text, 0), *words)


def test_wrenches_go_where_they_are_taken():
    assert requests.parse_computation(MECHANISM, "base_wrench", 1, wrench=True).wrench
    with expect_refusal("poses takes no wrenches; these do: inverse_dyn"):
        requests.parse_computation(MECHANISM, "poses:tool", 1, wrench=True)
