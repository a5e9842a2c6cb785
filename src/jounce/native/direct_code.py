"""The code of direct calls in LLVM IR, the same for all kernels; `direct` says what it does."""

from jounce.native.direct_arguments import define_arguments
from jounce.native.direct_layout import (
    ARRAY_DATA,
    DOUBLE,
    EXCEPTIONS,
    FAILURES,
    MAX_AXES,
    MAX_CLOSING_NUMBERS,
    MAX_LISTED,
    MAX_PORTS,
    NEEDED,
    OTHERS_SLOT,
    PORT_WORDS,
    TABLE_SLOT,
    TUPLE_ITEMS,
    TUPLE_LENGTH,
    WRITABLE,
    CallWriter,
)  # fmt: skip
from jounce.native.jit import Target


def module(target: Target) -> str:
    """The module of ``@compute``, which takes the numbers of its arguments to the code of a kernel."""
    ir = CallWriter(target)
    ir.lines.append(f"@needed = global [{len(NEEDED)} x ptr] zeroinitializer")
    define_arguments(ir)
    _define_results(ir)
    _define_collect(ir)
    _define_attempt(ir)
    _define_entry(ir)
    return ir.text()


def _define_entry(ir: CallWriter) -> None:
    """A function of CPython's protocol METH_FASTCALL | METH_KEYWORDS."""
    with ir.function("ptr @compute(ptr %self, ptr %args, i64 %count, ptr %names)"):
        ir.do(f"%table = load ptr, ptr {ir.at(ir.field('%self', TABLE_SLOT), ARRAY_DATA, 'i8')}")
        given, into, left = (ir.let(f"alloca {kind}") for kind in (f"[{MAX_PORTS} x ptr]", "i1", "i64"))
        ir.require(ir.compare("i64", "%count", ir.named("positional")))
        with ir.each("0", "%count") as k:
            ir.do(f"store ptr {ir.pointer('%args', k)}, ptr {ir.at(given, k, 'ptr')}")
        ir.do(f"store i1 false, ptr {into}")
        ir.do(f"store i64 {ir.named('required')}, ptr {left}")
        with (
            ir.only_if(ir.compare("ptr", "%names", "null", "ne"), "named", "complete"),
            ir.each("0", ir.field("%names", TUPLE_LENGTH, "i64")) as k,
        ):
            name = ir.pointer(ir.at("%names", TUPLE_ITEMS, "i8"), k)
            value = ir.pointer("%args", ir.let(f"add i64 %count, {k}"))
            ir.do(f"br i1 {ir.compare('ptr', name, ir.needed('out'))}, label %out, label %input")
            ir.label("out")
            inputs, end = ir.named("inputs"), ir.named("end")
            to, results = ir.at(given, inputs, "ptr"), ir.let(f"sub i64 {end}, {inputs}")
            ir.require(ir.let(f"call i1 @spread(ptr {to}, i64 {results}, ptr {value}, i1 true)"))
            ir.do(f"store i1 true, ptr {into}")
            ir.do("br label %taken")
            ir.label("input")
            ir.require(ir.let(f"call i1 @take(ptr %table, ptr {given}, ptr {name}, ptr {value})"))
            before = ir.let(f"load i64, ptr {left}")
            ir.do(f"store i64 {ir.let(f'sub i64 {before}, 1')}, ptr {left}")
            ir.do("br label %taken")
            ir.label("taken")
        ir.require(ir.compare("i64", ir.let(f"load i64, ptr {left}"), 0))
        given_into = ir.let(f"load i1, ptr {into}")
        found = ir.let(f"call ptr @attempt(ptr %table, ptr {given}, i1 {given_into})")
        ir.require(ir.compare("ptr", found, "@needed", "ne"))
        ir.do(f"ret ptr {found}")
        ir.label("declined")
        others, call = ir.field("%self", OTHERS_SLOT), ir.needed("call")
        ir.do(f"ret ptr {ir.let(f'call ptr {call}(ptr {others}, ptr %args, i64 %count, ptr %names)')}")


def _define_attempt(ir: CallWriter) -> None:
    """``@attempt(table, args, into)``: the objects of the results, ``@needed`` where it does not accept the arguments.

    Null is an error of Python, of memory.
    """
    with ir.function("internal ptr @attempt(ptr %table, ptr %given, i1 %into)"):
        numbers = (MAX_LISTED, "double"), (MAX_CLOSING_NUMBERS, "double")
        kinds = (MAX_PORTS, "ptr"), (MAX_PORTS, "ptr"), *numbers, (1, "i64"), (1, "i64"), (1, "i32")
        places, objects, listed, near, used, one, state = (ir.let(f"alloca [{n} x {kind}]") for n, kind in kinds)
        inputs, end, ports = ir.named("inputs"), ir.named("end"), ir.ports()
        for place, number in ((used, 0), (one, 1)):
            ir.do(f"store i64 {number}, ptr {place}")
        for first, last in (("0", ir.named("given")), (end, ir.named("all"))):
            with ir.each(first, last) as k:
                arguments = f"ptr {ir.port(ports, k)}, ptr {ir.pointer('%given', k)}, ptr {ir.at(places, k, 'ptr')}"
                ir.require(ir.let(f"call i1 @accept({arguments}, ptr {listed}, ptr {used})"))
        pose = ir.named("pose")
        with ir.only_if(ir.compare("i64", pose, 0, "sge"), "base", "posed"):
            ir.require(ir.let(f"call i1 @is_pose(ptr %table, ptr {ir.pointer(places, pose)})"))
        closing = ir.named("closing", "ptr")
        with ir.only_if(ir.compare("ptr", closing, "null", "ne"), "open", "closed"):
            dependent = ir.at(places, ir.named("given"), "ptr")
            ir.require(ir.let(f"call i1 @close(ptr {closing}, ptr {places}, ptr {dependent}, ptr {near})"))
        arguments = f"ptr {ports}, ptr {places}, ptr {objects}, i64 {inputs}, i64 {end}"
        ir.do("br i1 %into, label %old, label %new")
        ir.label("old")
        ir.require(ir.let(f"call i1 @hold(ptr %given, {arguments})"))
        ir.do("br label %compute")
        ir.label("new")
        ir.require(ir.let(f"call i1 @allocate({arguments})"), "short")
        ir.do("br label %compute")
        ir.label("compute")
        _set_status(ir, state, ir.let(f"and i32 {_status(ir, state)}, {~EXCEPTIONS}"))
        code, pool, strides = (ir.named(name, "ptr") for name in ("code", "pool", "strides"))
        ir.do(f"call void {code}(ptr {places}, ptr {one}, ptr {strides}, ptr {pool})")
        failed = ir.let(f"and i32 {_status(ir, state)}, {FAILURES}")
        with ir.only_if(ir.compare("i32", failed, 0, "ne"), "failed", "computed"):
            ir.do(f"call void @drop(ptr {objects}, i64 {inputs}, i64 {end})")
            ir.do("br label %declined")
        ir.do(f"ret ptr {ir.let(f'call ptr @collect(ptr %table, ptr {objects}, i1 %into)')}")
        ir.label("declined")
        ir.do("ret ptr @needed")
        ir.label("short")
        ir.do("ret ptr null")


def _define_results(ir: CallWriter) -> None:
    """Functions on results: to hold those that are given, to allocate new ones, to drop them."""
    with ir.check("lies_apart(ptr %ports, ptr %places, i64 %last)"):
        start, size = _span(ir, "%last")
        end = ir.at(start, size)
        with ir.each("0", "%last") as j:
            other, length = _span(ir, j)
            before, after = ir.compare("ptr", end, other, "ule"), ir.compare("ptr", ir.at(other, length), start, "ule")
            ir.require(ir.let(f"or i1 {before}, {after}"))
    with ir.function("internal void @drop(ptr %objects, i64 %start, i64 %end)"), ir.each("%start", "%end") as k:
        ir.do(f"call void {ir.needed('decrease')}(ptr {ir.pointer('%objects', k)})")
    arguments = "ptr %ports, ptr %places, ptr %objects, i64 %start, i64 %end"
    with ir.check(f"hold(ptr %given, {arguments})"):
        with ir.each("%start", "%end") as k:
            target = ir.pointer("%given", k)
            found = ir.let(f"call ptr @numbers(ptr {ir.port('%ports', k)}, ptr {target}, i32 {WRITABLE})")
            ir.require(ir.compare("ptr", found, "null", "ne"))
            _store_result(ir, k, target, found)
            ir.require(ir.let(f"call i1 @lies_apart(ptr %ports, ptr %places, i64 {k})"))
        with ir.each("%start", "%end") as k:  # only now: what is declined is not held
            ir.do(f"call void {ir.needed('increase')}(ptr {ir.pointer('%objects', k)})")
    with ir.function(f"internal i1 @allocate({arguments})"):
        with ir.each("%start", "%end") as k:
            port = ir.port("%ports", k)
            lengths, axes = ir.at(port, PORT_WORDS - MAX_AXES, "i64"), ir.let(f"trunc i64 {ir.word(port, 0)} to i32")
            rest = f"i32 {axes}, ptr {lengths}, i32 {DOUBLE}, ptr null, ptr null, i32 0, i32 0, ptr null"
            made = ir.let(f"call ptr {ir.needed('new_array')}(ptr {ir.needed('ndarray')}, {rest})")
            ir.require(ir.compare("ptr", made, "null", "ne"), "short")
            _store_result(ir, k, made, ir.field(made, ARRAY_DATA))
        ir.do("ret i1 true")
        ir.label("short")
        ir.do(f"call void @drop(ptr %objects, i64 %start, i64 {k})")
        ir.do("ret i1 false")


def _store_result(ir: CallWriter, k: str, held: str, numbers: str) -> None:
    ir.do(f"store ptr {held}, ptr {ir.at('%objects', k, 'ptr')}")
    ir.do(f"store ptr {numbers}, ptr {ir.at('%places', k, 'ptr')}")


def _span(ir: CallWriter, k: str) -> tuple[str, str]:
    """Where the numbers of a port begin, and how many they are."""
    return ir.pointer("%places", k), ir.word(ir.port("%ports", k), 1)


def _define_collect(ir: CallWriter) -> None:
    """``@collect(table, objects, into)``: one result, or a tuple; new ones without axes are scalars, as of a ufunc."""
    with ir.function("internal ptr @collect(ptr %table, ptr %objects, i1 %into)"):
        first, end, ports = ir.named("inputs"), ir.named("end"), ir.ports()
        count = ir.let(f"sub i64 {end}, {first}")
        with ir.only_if(ir.let("xor i1 %into, true"), "new", "ready"), ir.each(first, end) as k:
            axes = ir.word(ir.port(ports, k), 0)
            with ir.only_if(ir.compare("i64", axes, 0), "scalar", "other"):
                scalar = ir.let(f"call ptr {ir.needed('scalar')}(ptr {ir.pointer('%objects', k)})")
                ir.require(ir.compare("ptr", scalar, "null", "ne"), "lost")
                ir.do(f"store ptr {scalar}, ptr {ir.at('%objects', k, 'ptr')}")
        with ir.only_if(ir.compare("i64", count, 1), "single", "several"):
            ir.do(f"ret ptr {ir.pointer('%objects', first)}")
        together = ir.let(f"call ptr {ir.needed('new_tuple')}(i64 {count})")
        with ir.only_if(ir.compare("ptr", together, "null"), "short", "filled"):
            ir.do(f"call void @drop(ptr %objects, i64 {first}, i64 {end})")
            ir.do("ret ptr null")
        with ir.each(first, end) as j:
            place = ir.let(f"sub i64 {j}, {first}")
            ir.let(f"call i32 {ir.needed('set_item')}(ptr {together}, i64 {place}, ptr {ir.pointer('%objects', j)})")
        ir.do(f"ret ptr {together}")
        ir.label("lost")  # memory is short: the other objects are dropped
        ir.do(f"call void @drop(ptr %objects, i64 {first}, i64 {k})")
        ir.do(f"call void @drop(ptr %objects, i64 {ir.let(f'add i64 {k}, 1')}, i64 {end})")
        ir.do("ret ptr null")


def _status(ir: CallWriter, state: str) -> str:
    """The control and status register of floating-point numbers of x86."""
    ir.declared["declare void @llvm.x86.sse.stmxcsr(ptr)"] = None
    ir.do(f"call void @llvm.x86.sse.stmxcsr(ptr {state})")
    return ir.let(f"load i32, ptr {state}")


def _set_status(ir: CallWriter, state: str, value: str) -> None:
    ir.declared["declare void @llvm.x86.sse.ldmxcsr(ptr)"] = None
    ir.do(f"store i32 {value}, ptr {state}")
    ir.do(f"call void @llvm.x86.sse.ldmxcsr(ptr {state})")
