"""Counts of instructions: what is read from assembly and object code is what is there."""

from collections import Counter

import pytest

import jounce
from benchmarks import bound, instructions
from jounce.dynamics.computation import Computation
from jounce.native import code_forms
from jounce.native.straight import PARTIAL_SUMS

X86 = """\
	.text
	.type	sincos,@function
sincos:
	retq
.Lfunc_end0:
	.size	sincos, .Lfunc_end0-sincos
block:
.LBB1_0:
	pushq	%rbx
	leaq	64(%rsp), %rdi
	movabsq	$sincos, %r15
	callq	*%r15
	vmovupd	(%r14), %ymm0
	vbroadcastsd	.LCPI8_1(%rip), %ymm13
	vmulpd	128(%rsp,%rax,8), %ymm4, %ymm9
	vfnmadd231pd	(%rax){1to8}, %zmm2, %zmm3
	vaddpd	%ymm6, %ymm5, %ymm2
	vmovapd	%ymm3, (%rsp)
	callq	part
	popq	%rbx
	retq
part:
	vsubsd	%xmm0, %xmm1, %xmm0
	jmp	last
last:
	retq
other:
	retq
	.section	.rodata
places.0:
	.quad	0
"""
ARM = """\
block:
	stp	x29, x30, [sp, #-48]!
	ldp	q2, q0, [x0]
	movi	v4.2d, #0000000000000000
	fmla	v4.2d, v4.2d, v2.2d
	fneg	v1.2d, v1.2d
	str	q4, [sp, #48]
	bl	sincos
	ret
sincos:
	fadd	d0, d0, d0
	ret
"""


@pytest.mark.parametrize(
    ("assembly", "names", "expected"),
    [
        (X86, {"block", "part", "last"}, {"instructions": 16, "arithmetic": 4, "loads": 5, "folded": 2, "stores": 2}),
        (ARM, {"block"}, {"instructions": 8, "arithmetic": 1, "loads": 1, "stores": 2}),
    ],
)
def test_instructions_of_a_block_are_read(assembly, names, expected):
    lines = instructions.functions(assembly)
    assert instructions.reached(lines, "block") == names
    counts = instructions.Code(lines, dict.fromkeys(lines, 7)).counts()
    assert counts == Counter(expected, bytes=7 * len(names))


@pytest.mark.parametrize("target", instructions.TARGETS)
def test_counts_are_those_of_the_program(target):
    robot, asked = jounce.load("planar2r"), Computation("inverse_dynamics", 1)
    code = instructions.compiled(robot, asked, instructions.TARGETS[target])
    assert code.lines.keys() == code.sizes.keys()
    for name, lines in code.lines.items():
        assert len(lines) <= code.sizes[name] <= 15 * len(lines)
        assert code.sizes[name] == 4 * len(lines) or not target.startswith("NEON")
    counts, signature = code.counts(), asked.signature(robot.mechanism)
    program = bound.of_program(code_forms.trace_program(robot.mechanism, asked))
    checks = counts["arithmetic"] - program.products - program.sums
    read, written = signature.inputs[-1].end, signature.outputs[-1].end
    joined = (PARTIAL_SUMS - 1) * len(signature.inputs)
    assert read + written <= checks <= read + written + joined + 8  # of inputs and outputs for what is not finite
    assert counts["loads"] >= read / 2
    assert counts["stores"] >= written / 2
