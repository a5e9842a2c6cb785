"""The code of direct calls that accepts arguments: arrays, lists of numbers, keywords, poses, loops to be closed."""

from jounce.arguments.poses import POSE_TOLERANCE
from jounce.native.direct_layout import (
    ARRAY_DATA,
    ARRAY_DTYPE,
    ARRAY_FLAGS,
    ARRAY_LENGTHS,
    ARRAY_RANK,
    CLOSING_WORDS,
    FLOAT_VALUE,
    KEYWORD_WORDS,
    LIST_ITEMS,
    LIST_LENGTH,
    MAX_AXES,
    MAX_LISTED,
    OBJECT_TYPE,
    PORT_WORDS,
    READABLE,
    TUPLE_ITEMS,
    TUPLE_LENGTH,
    CallWriter,
)  # fmt: skip


def define_arguments(ir: CallWriter) -> None:
    """``@accept``, ``@spread``, ``@take``, ``@is_pose`` and ``@close``, each of which may decline."""
    _define_numbers(ir)
    _define_copy(ir)
    _define_accept(ir)
    _define_keywords(ir)
    _define_pose(ir)
    _define_closing(ir)


def _define_numbers(ir: CallWriter) -> None:
    """``@numbers(port, object, flags)``: those of an array with the shape of a port and the flags, else null."""
    with ir.function("internal ptr @numbers(ptr %port, ptr %object, i32 %flags)"):
        ir.require(ir.compare("ptr", ir.field("%object", OBJECT_TYPE), ir.needed("ndarray")))
        ir.require(ir.compare("ptr", ir.field("%object", ARRAY_DTYPE), ir.needed("float64")))
        own = ir.let(f"and i32 {ir.field('%object', ARRAY_FLAGS, 'i32')}, %flags")
        ir.require(ir.compare("i32", own, "%flags"))
        axes, lengths = ir.word("%port", 0), ir.field("%object", ARRAY_LENGTHS)
        ir.require(ir.compare("i64", ir.let(f"sext i32 {ir.field('%object', ARRAY_RANK, 'i32')} to i64"), axes))
        with ir.each("0", axes) as j:
            expected = ir.word("%port", ir.let(f"add i64 {j}, {PORT_WORDS - MAX_AXES}"))
            ir.require(ir.compare("i64", ir.word(lengths, j), expected))
        ir.do(f"ret ptr {ir.field('%object', ARRAY_DATA)}")
        ir.label("declined")
        ir.do("ret ptr null")


def _define_copy(ir: CallWriter) -> None:
    """``@copy(port, object, to)``: whether an object is a list of numbers as long as a vector; then they are copied."""
    with ir.function("internal i1 @copy(ptr %port, ptr %object, ptr %to)"):
        ir.require(ir.compare("ptr", ir.field("%object", OBJECT_TYPE), ir.needed("list")))
        ir.require(ir.compare("i64", ir.word("%port", 0), 1))
        length = ir.field("%object", LIST_LENGTH, "i64")
        ir.require(ir.compare("i64", length, ir.word("%port", 1)))
        items, kinds = ir.field("%object", LIST_ITEMS), [ir.needed(name) for name in ("float", "double", "int")]
        with ir.each("0", length) as j:
            item = ir.let(f"load ptr, ptr {ir.at(items, j, 'ptr')}")
            kind, place = ir.field(item, OBJECT_TYPE), ir.at("%to", j)
            is_float, is_double, is_int = (ir.compare("ptr", kind, known) for known in kinds)
            ir.do(f"br i1 {ir.let(f'or i1 {is_float}, {is_double}')}, label %real, label %other")
            ir.label("real")
            ir.do(f"store double {ir.field(item, FLOAT_VALUE, 'double')}, ptr {place}")
            ir.do("br label %copied")
            ir.label("other")
            ir.require(is_int)
            x = ir.let(f"call double {ir.needed('as_double')}(ptr {item})")
            ir.do(f"store double {x}, ptr {place}")
            ir.do(f"br i1 {ir.let(f'fcmp oeq double {x}, -1.0')}, label %doubtful, label %copied")
            ir.label("doubtful")  # minus one, or too large
            ir.require(ir.compare("ptr", ir.let(f"call ptr {ir.needed('occurred')}()"), "null"), "large")
            ir.do("br label %copied")
            ir.label("copied")
        ir.do("ret i1 true")
        ir.label("large")
        ir.do(f"call void {ir.needed('clear')}()")
        ir.do("br label %declined")
        ir.label("declined")
        ir.do("ret i1 false")


def _define_accept(ir: CallWriter) -> None:
    """``@accept``: store where the numbers of an argument are, in its array or copied from its list."""
    with ir.check("accept(ptr %port, ptr %object, ptr %place, ptr %listed, ptr %used)"):
        found = ir.let(f"call ptr @numbers(ptr %port, ptr %object, i32 {READABLE})")
        ir.do(f"store ptr {found}, ptr %place")
        with ir.only_if(ir.compare("ptr", found, "null"), "list", "accepted"):
            start, size = ir.let("load i64, ptr %used"), ir.word("%port", 1)
            after, copy = ir.let(f"add i64 {start}, {size}"), ir.at("%listed", start)
            ir.require(ir.compare("i64", after, MAX_LISTED, "sle"))
            ir.require(ir.let(f"call i1 @copy(ptr %port, ptr %object, ptr {copy})"))
            ir.do(f"store ptr {copy}, ptr %place")
            ir.do(f"store i64 {after}, ptr %used")


def _define_keywords(ir: CallWriter) -> None:
    """Functions that put the objects of a tuple, and the arguments of a keyword, among those of positions."""
    with ir.function("internal i1 @spread(ptr %to, i64 %count, ptr %value, i1 %lists)"):
        kind = ir.field("%value", OBJECT_TYPE)
        listed = ir.let(f"and i1 {ir.compare('ptr', kind, ir.needed('list'))}, %lists")
        is_tuple = ir.compare("ptr", kind, ir.needed("tuple"))
        with ir.only_if(ir.let(f"or i1 {is_tuple}, {listed}"), "several", "single"):
            ir.require(ir.compare("i64", ir.field("%value", TUPLE_LENGTH, "i64"), "%count"))
            inside = ir.at("%value", TUPLE_ITEMS, "i8")
            outside = ir.field("%value", LIST_ITEMS)
            items = ir.let(f"select i1 {is_tuple}, ptr {inside}, ptr {outside}")
            with ir.each("0", "%count") as k:
                ir.do(f"store ptr {ir.pointer(items, k)}, ptr {ir.at('%to', k, 'ptr')}")
            ir.do("ret i1 true")
        ir.do("store ptr %value, ptr %to")
        ir.do(f"ret i1 {ir.compare('i64', '%count', 1)}")
        ir.label("declined")
        ir.do("ret i1 false")
    with ir.function("internal i1 @take(ptr %table, ptr %given, ptr %name, ptr %value)"):
        rows = ir.named("keywords", "ptr")
        with ir.each("0", ir.named("required")) as k:
            row = ir.at(rows, ir.let(f"mul i64 {k}, {KEYWORD_WORDS}"), "i64")
            with ir.only_if(ir.compare("ptr", ir.pointer(row, 0), "%name"), "found", "other"):
                count = ir.word(row, 2)
                with ir.only_if(ir.compare("i64", count, 0), "constant", "arrays"):
                    ir.do(f"ret i1 {ir.compare('ptr', ir.pointer(row, 3), '%value')}")
                to = ir.at("%given", ir.word(row, 1), "ptr")
                ir.do(f"ret i1 {ir.let(f'call i1 @spread(ptr {to}, i64 {count}, ptr %value, i1 false)')}")
        ir.do("ret i1 false")


def _define_pose(ir: CallWriter) -> None:
    """``@is_pose(table, matrix)``: whether a matrix is certainly a pose."""
    with ir.function("internal i1 @is_pose(ptr %table, ptr %matrix)"):
        one, miss, both = (ir.let(f"alloca {kind}") for kind in ("i64", "double", "[2 x ptr]"))
        ir.do(f"store i64 1, ptr {one}")
        for k, array in enumerate(("%matrix", miss)):
            ir.do(f"store ptr {array}, ptr {ir.at(both, k, 'ptr')}")
        check, strides = ir.named("check", "ptr"), ir.named("check_strides", "ptr")
        ir.do(f"call void {check}(ptr {both}, ptr {one}, ptr {strides}, ptr null)")
        bound = ir.number(POSE_TOLERANCE**2)
        ir.do(f"ret i1 {ir.let(f'fcmp ole double {ir.double(miss, 0)}, {bound}')}")


def _define_closing(ir: CallWriter) -> None:
    """``@close(table, q, dependent, memory)``: whether loops were nearly closed; q is then that of the kernel.

    This is the usual case of `loop_closure.NativeStep.close`: one step both checks that loops are closed and removes
    their rounding errors; the measures and the places of followers are within their bounds.
    """

    def named(name: str, kind: str = "ptr") -> str:
        return ir.named(name, kind, CLOSING_WORDS)

    with ir.check("close(ptr %table, ptr %q, ptr %dependent, ptr %memory)"):
        one, arrays = ir.let("alloca i64"), ir.let("alloca [5 x ptr]")
        ir.do(f"store i64 1, ptr {one}")
        q, others = ir.let("load ptr, ptr %q"), named("others")
        independent = ir.at("%memory", named("dependent", "i64"))
        measures = ir.at(independent, named("independent", "i64"))
        for place, array in enumerate((q, named("still"), "%memory", measures, ir.at(measures, 2))):
            ir.do(f"store ptr {array}, ptr {ir.at(arrays, place, 'ptr')}")
        code, pool, strides = (named(name) for name in CLOSING_WORDS[:3])
        ir.do(f"call void {code}(ptr {arrays}, ptr {one}, ptr {strides}, ptr {pool})")
        most = named("most")
        for measure in range(2):
            ir.require(ir.let(f"fcmp ole double {ir.double(measures, measure)}, {ir.double(most, measure)}"))
        following, bounds = named("following"), named("in_place")
        with ir.each("0", named("followers", "i64")) as k:
            own_place = ir.word(following, k)
            off = ir.let(f"fsub double {ir.double('%memory', own_place)}, {ir.double(q, ir.word(others, own_place))}")
            size = ir.call("llvm.fabs.f64", "double", off)
            ir.require(ir.let(f"fcmp ole double {size}, {ir.double(bounds, k)}"))
        own = named("own")
        with ir.each("0", named("independent", "i64")) as k:
            ir.do(f"store double {ir.double(q, ir.word(own, k))}, ptr {ir.at(independent, k)}")
        ir.do(f"store ptr {independent}, ptr %q")
        ir.do("store ptr %memory, ptr %dependent")
