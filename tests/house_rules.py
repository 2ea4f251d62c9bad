"""Rules of the house, read from source with ``ast``: each takes a file's path and text and returns what breaks it."""

import ast
import sys
from collections.abc import Iterator
from dataclasses import dataclass

OURS = {"sonarwarp", "sonarwarp_kernels", "sonarwarp_scenes", "benchmarks", "tests"}

# All that the library may know of a scene: where it is and how a vehicle moved in it.
PLAIN_SCENE_TYPES = {"Scene", "Trajectory"}

LONGEST_KERNEL_FILE = 350
"""Lines of a file that stays readable in one sitting."""

ALLOCATIONS = {
    *("array", "indexedarray", "fabricarray", "from_numpy", "from_torch", "from_jax", "from_paddle", "from_dlpack"),
    *("zeros", "zeros_like", "ones", "ones_like", "full", "full_like", "empty", "empty_like", "clone"),
    *("Mesh", "Bvh", "HashGrid", "Volume", "MarchingCubes", "Texture2D", "Texture3D", "Stream", "Event"),
}
"""What of Warp takes memory."""

HOST_READS = {"numpy", "list"}
"""Methods of an array that wait for the device and copy."""

PLACED_IN_KERNELS = {
    *("warp.kernel", "warp.func", "warp.func_native", "warp.func_grad", "warp.func_replay", "warp.Kernel", "warp.map"),
    *("warp.launch", "warp.launch_tiled", "sonarwarp_kernels.launch.launch"),
}
"""What makes or launches device code."""


@dataclass(frozen=True)
class Floor:
    """What the files of a folder may import, besides the standard library."""

    folder: str
    ours: set[str]  # our packages
    loading: set[str] | None  # others' packages as a module loads; None for all
    late: set[str] | None  # others' packages inside functions or for type checkers only; None for all


LIBRARY = {"sonarwarp", "sonarwarp_kernels", "sonarwarp_scenes"}

# The first folder that a path lies in counts.
FLOORS = (
    Floor("kernels/", {"sonarwarp_kernels"}, {"warp"}, {"warp"}),
    Floor("scenes/", {"sonarwarp_scenes"}, {"warp", "numpy"}, {"warp", "numpy", "trimesh", "pxr"}),
    Floor("sonarwarp/app/", LIBRARY, None, None),
    Floor("sonarwarp/examples/", LIBRARY, None, None),
    Floor("sonarwarp/newton/", LIBRARY, {"warp", "numpy", "newton"}, None),
    Floor("sonarwarp/", LIBRARY, {"warp", "numpy"}, None),
    Floor("benchmarks/", LIBRARY | {"benchmarks"}, None, None),
)

TOP_FLOOR = ("sonarwarp/app/", "sonarwarp/examples/", "benchmarks/")


@dataclass(frozen=True)
class Import:
    """One imported name: ``from a import b`` as ``a.b``."""

    line: int
    name: str
    late: bool


def _absolute(path: str, node: ast.ImportFrom) -> str:
    """Module that a from-import names; relative ones are resolved against the file's own package."""
    if node.level == 0:
        return node.module or ""
    parts = [part for part in path.split("/")[:-1] if part not in ("kernels", "scenes")]
    parts = parts[: len(parts) - node.level + 1]
    return ".".join([*parts, *([node.module] if node.module else [])])


def imports(path: str, tree: ast.AST, late: bool = False) -> Iterator[Import]:
    """Every import below ``tree``, those by ``importlib.import_module`` of a literal name too."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Import):
            yield from (Import(node.lineno, alias.name, late) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from (Import(node.lineno, f"{_absolute(path, node)}.{alias.name}", late) for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in ("import_module", "__import__"):
            literal = [name.value for name in node.args[:1] if isinstance(name, ast.Constant)]
            yield from (Import(node.lineno, str(name), late) for name in literal)
        deferred = isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda) or (
            isinstance(node, ast.If) and ast.unparse(node.test).split(".")[-1] == "TYPE_CHECKING"
        )
        yield from imports(path, node, late or deferred)


def floor_of(path: str) -> Floor:
    return next(floor for floor in FLOORS if path.startswith(floor.folder))


def reaches_up(path: str, source: str) -> list[str]:
    """Imports of something above the file's floor, or of a package that its floor does without."""
    floor = floor_of(path)
    found = []
    for entry in imports(path, ast.parse(source)):
        root = entry.name.split(".")[0]
        if root in OURS:
            allowed = root in floor.ours
            if path.startswith("sonarwarp/") and not path.startswith(TOP_FLOOR):
                allowed = allowed and not f"{entry.name}.".startswith(("sonarwarp.app.", "sonarwarp.examples."))
                allowed = allowed and (root != "sonarwarp_scenes" or entry.name.split(".")[-1] in PLAIN_SCENE_TYPES)
        else:
            others = floor.late if entry.late else floor.loading
            allowed = root in sys.stdlib_module_names or others is None or root in others
        if not allowed:
            found.append(f"{path}:{entry.line} imports {entry.name}")
    return found


class Names:
    """Full dotted names of what a file calls by its own aliases."""

    def __init__(self, path: str, tree: ast.AST):
        self._alias: dict[str, str] = {}
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    self._alias[alias.asname or alias.name.split(".")[0]] = (
                        alias.name if alias.asname else alias.name.split(".")[0]
                    )
            elif isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    self._alias[alias.asname or alias.name] = f"{_absolute(path, node)}.{alias.name}"

    def of(self, node: ast.AST) -> str:
        """Full name, or an empty string for what no import brought."""
        if isinstance(node, ast.Name):
            return self._alias.get(node.id, "")
        if isinstance(node, ast.Attribute):
            base = self.of(node.value)
            return f"{base}.{node.attr}" if base else ""
        return ""

    def is_decorated(self, node: ast.AST, *names: str) -> bool:
        return isinstance(node, ast.FunctionDef) and any(
            self.of(mark.func if isinstance(mark, ast.Call) else mark) in names for mark in node.decorator_list
        )


def _host_nodes(names: Names, tree: ast.AST) -> Iterator[ast.AST]:
    """Nodes that run on the host: no body of a kernel or func, and no annotation."""
    for field, value in ast.iter_fields(tree):
        if field in ("annotation", "returns"):
            continue
        for node in value if isinstance(value, list) else [value]:
            if isinstance(node, ast.AST) and not names.is_decorated(node, "warp.kernel", "warp.func"):
                yield node
                yield from _host_nodes(names, node)


def _is_type(call: ast.Call) -> bool:
    """Whether a call names a type of array, as annotations and overloads do, and makes none."""
    return not call.args and {keyword.arg for keyword in call.keywords} <= {"dtype", "ndim"} and bool(call.keywords)


def costs_on_host(path: str, source: str) -> list[str]:
    """Host code that allocates, synchronises or reads an array back: a launcher could not be captured into a graph."""
    tree = ast.parse(source)
    names = Names(path, tree)
    found = []
    for node in _host_nodes(names, tree):
        if not isinstance(node, ast.Call):
            continue
        module, _, name = names.of(node.func).rpartition(".")
        if module == "warp" and (name in ALLOCATIONS or name.startswith("synchronize")) and not _is_type(node):
            found.append(f"{path}:{node.lineno} calls wp.{name}")
        elif isinstance(node.func, ast.Attribute) and node.func.attr in HOST_READS:
            found.append(f"{path}:{node.lineno} calls .{node.func.attr}()")
    return found


def holds_device_code(path: str, source: str) -> list[str]:
    """Kernels, funcs and launches, which belong in ``kernels/``."""
    tree = ast.parse(source)
    names = Names(path, tree)
    return [
        f"{path}:{node.lineno} uses {names.of(node)}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Name | ast.Attribute) and names.of(node) in PLACED_IN_KERNELS
    ]


def _kernels(path: str, source: str) -> list[ast.FunctionDef]:
    tree = ast.parse(source)
    names = Names(path, tree)
    return [
        node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and names.is_decorated(node, "warp.kernel")
    ]


def breaks_signature(path: str, source: str) -> list[str]:
    """Kernels without ``first: int`` in front, ``*_out`` last, a shape at every array, or a launcher beside them."""
    found = []
    launched = {node.id for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Name)}
    lines = source.splitlines()
    for kernel in _kernels(path, source):
        where = f"{path}:{kernel.lineno} {kernel.name}"
        arguments = kernel.args.args
        names = [argument.arg for argument in arguments]
        if not kernel.name.endswith("_kernel"):
            found.append(f"{where}: name does not end in _kernel")
        if kernel.name not in launched:
            found.append(f"{where}: no launcher uses it")
        first = arguments[0] if arguments else None
        if first is None or first.arg != "first" or first.annotation is None or ast.unparse(first.annotation) != "int":
            found.append(f"{where}: first argument is not first: int")
        outputs = [name.endswith("_out") for name in names]
        if not any(outputs) or outputs != sorted(outputs):
            found.append(f"{where}: outputs *_out do not come last")
        for argument in arguments:
            of_array = argument.annotation is not None and "array" in ast.unparse(argument.annotation)
            if of_array and "# [" not in lines[argument.lineno - 1]:
                found.append(f"{where}: no shape comment for {argument.arg}")
    return found


def _written_array(target: ast.expr) -> str:
    """Name at the root of a subscripted ``target``, or an empty string."""
    subscripted = False
    while isinstance(target, ast.Subscript | ast.Attribute):
        subscripted = subscripted or isinstance(target, ast.Subscript)
        target = target.value
    return target.id if subscripted and isinstance(target, ast.Name) else ""


def writes_inputs(path: str, source: str) -> list[str]:
    """Kernels that write to an array argument whose name does not end in ``_out``."""
    names = Names(path, ast.parse(source))
    found = []
    for kernel in _kernels(path, source):
        inputs = {argument.arg for argument in kernel.args.args if not argument.arg.endswith("_out")}
        for node in ast.walk(kernel):
            if isinstance(node, ast.Assign):
                written = [_written_array(target) for target in node.targets]
            elif isinstance(node, ast.AugAssign):
                written = [_written_array(node.target)]
            elif isinstance(node, ast.Call) and names.of(node.func).startswith(("warp.atomic_", "warp.tile_store")):
                written = [node.args[0].id] if isinstance(node.args[0], ast.Name) else []
            else:
                continue
            found += [f"{path}:{node.lineno} {kernel.name} writes to {name}" for name in written if name in inputs]
    return found


def compiles_backward(path: str, source: str) -> list[str]:
    """Files with device code that do not switch the backward pass off for the whole module."""
    tree = ast.parse(source)
    names = Names(path, tree)
    has_device_code = any(names.is_decorated(node, "warp.kernel", "warp.func") for node in ast.walk(tree))
    switched_off = any(
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Call)
        and names.of(node.value.func) == "warp.set_module_options"
        and isinstance(options := ast.literal_eval(node.value.args[0]), dict)
        and options.get("enable_backward") is False
        for node in tree.body
    )
    return [f"{path} does not switch enable_backward off"] if has_device_code and not switched_off else []


def is_too_long(path: str, source: str) -> list[str]:
    """Files that no longer read in one sitting."""
    lines = len(source.splitlines())
    return [f"{path} has {lines} lines, more than {LONGEST_KERNEL_FILE}"] if lines > LONGEST_KERNEL_FILE else []
