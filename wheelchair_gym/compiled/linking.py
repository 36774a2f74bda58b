"""From kernels to machine code: dispatchers, a cache and an LLVM engine of our own.

numba links a function's code into each caller and makes machine code of it there again, and again
in the callers of these: a kernel ten calls deep is translated ten times. Here a kernel that
another kernel calls stays optimised LLVM code (a part), without machine code and without a wrapper
for Python, until a kernel that Python calls is finished. Each part is optimised as numba would do
it: optimised only once, in the kernel that Python calls, the batch of chairs would be a fifth
slower.

All of this concerns kernels alone. They share numba's type system and its implementations, but have
an LLVM engine of their own, so that other users of numba in the process see no difference.
"""

# numba has few types.
# mypy: disable-error-code="no-untyped-call, attr-defined, override"

import contextlib
import gc
import pickle
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
from numba.core import sigutils, types
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler_lock import global_compiler_lock
from numba.core.environment import lookup_environment
from numba.core.registry import CPUDispatcher, CPUTarget, cpu_target

from wheelchair_gym.base.errors import InputError
from wheelchair_gym.compiled.clock import standing_still
from wheelchair_gym.compiled.second_process import locked, progress

_ENVIRONMENT = "_ZN08NumbaEnv"  # how numba's names of environments begin


class _Library(JITCodeLibrary):
    """A library that is translated to machine code only if Python calls it."""

    _merged = False

    def _merge(self) -> None:
        """Link all that this library calls into it, once."""
        if self._merged or self._finalized:
            return
        self._merged = True
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)

    def add_linking_library(self, library: Any) -> None:
        self._linking_libraries.append(library)

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is not None:
            return self._shared_module
        if self._finalized:
            return super()._get_module_for_linking()
        self._merge()
        self._optimize_final_module()
        module = self._final_module.clone()
        for function in module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "linkonce_odr"
        self._shared_module = module
        return module

    def finalize(self) -> None:
        self._merge()
        self._linking_libraries = []
        if self._shared_module is self._final_module:  # loaded, and called by a user's function
            self._final_module = self._shared_module.clone()
        super().finalize()
        for variable in self._final_module.global_variables:
            if variable.name.startswith(_ENVIRONMENT):
                environment = lookup_environment(variable.name)
                if environment is not None:
                    self.codegen.set_env(variable.name, environment)

    def get_pointer_to_function(self, name: str) -> int:
        if not self._finalized and not self._defines(name):
            return 0  # a part: no wrapper, nothing that Python could call
        return int(super().get_pointer_to_function(name))

    def _defines(self, name: str) -> bool:
        try:
            return not self._final_module.get_function(name).is_declaration
        except NameError:
            return False

    @property
    def has_dynamic_globals(self) -> bool:
        if self._finalized:
            return bool(super().has_dynamic_globals)
        self._get_module_for_linking()
        return any(
            v.name.startswith("numba.dynamic.globals") for v in self._final_module.global_variables
        )

    def serialize_using_object_code(self) -> Any:
        if self._finalized:
            return super().serialize_using_object_code()
        return self.name, "part", self._get_module_for_linking().as_bitcode()

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Any:
        name, kind, data = state
        if kind != "part":
            return super()._unserialize(codegen, state)
        self = codegen.create_library(name)
        self._final_module = self._shared_module = llvm.parse_bitcode(data)
        self._merged = True
        return self


class _Engine(JITCPUCodegen):
    """An LLVM engine that makes libraries of the kind above."""

    _library_class = _Library

    def set_env(self, env_name: str, env: Any) -> None:
        if self._engine.is_symbol_defined(env_name):
            super().set_env(env_name, env)


class _Target(CPUTarget):
    """numba's CPU with its types and implementations, and an engine of our own."""

    def __init__(self) -> None:
        super().__init__("cpu")
        engine = _Engine("wheelchair_gym")
        self._context = cpu_target.target_context.subtarget(_internal_codegen=engine)

    @property
    def target_context(self) -> Any:
        return self._context

    @property
    def typing_context(self) -> Any:
        return cpu_target.typing_context


class Part(CPUDispatcher):
    """A kernel as other kernels call it, compiled once on a machine.

    Args:
        function: to compile.
        digest: of all that it depends on; what was compiled for another digest is stale.
        options: numba's, by name.

    Raises:
        InputError: there is no writable folder for what is compiled.
    """

    targetdescr = _Target()
    prefix = "part-"  # of its files in the cache

    def __init__(self, function: Callable[..., Any], digest: str, options: dict[str, Any]) -> None:
        super().__init__(function, {}, options | {"nopython": True, "boundscheck": None})
        self.source_digest = digest
        try:
            self.enable_caching()
        except RuntimeError:  # numba found no folder
            raise InputError("no folder for kernels is writable: set NUMBA_CACHE_DIR") from None
        cache = self._cache._cache_file
        cache._source_stamp, load = digest, cache._load_index

        def load_index() -> Any:
            # It names the classes of arguments before its stamp is looked at: they may be gone.
            try:
                return load()
            except (AttributeError, ImportError, EOFError, pickle.UnpicklingError):
                return {}

        save, read = cache.save, cache.load

        def load_stamped(key: Any) -> Any:
            # The index is written before the file that it names, which may be an older kernel's.
            found = read(key) or [""]
            return pickle.loads(found[1]) if found[0] == f"{digest} {key}" else None

        cache._load_index, cache.load = load_index, load_stamped
        cache.save = lambda key, data: save(key, (f"{digest} {key}", cache._dump(data)))
        cache._index_name = f"{self.prefix}{cache._index_name}"
        cache._index_path = str(Path(cache._cache_path) / cache._index_name)
        cache._data_name_pattern = f"{self.prefix}{cache._data_name_pattern}"
        self.lock, self._load_index = Path(f"{cache._index_path}.lock"), load_index

    @property
    def is_compiled(self) -> bool:
        """Whether it is compiled for some arguments, here or in the cache."""
        return bool(self.overloads or self._load_index())

    def compile(self, sig: Any) -> Any:
        """Load the machine code for a signature, or compile it while other processes wait."""
        args, _ = sigutils.normalize_signature(sig)
        with standing_still(), global_compiler_lock:
            if args not in self.overloads and not self._load(args):
                with locked(self.lock), _no_collection(), progress.compiling(self.py_func):
                    super().compile(sig)
            return self.overloads[args].entry_point

    def _load(self, args: Any) -> bool:
        """Load from the cache, and return whether it was there."""
        found = self._cache.load_overload(args, self.targetctx)
        if found is not None:
            self.targetctx.insert_user_function(found.entry_point, found.fndesc, [found.library])
            self.add_overload(found)
        return found is not None

    def __reduce__(self) -> str:
        """Pickle by name."""
        return str(self.__qualname__)


class Kernel(Part):
    """A kernel as Python calls it; kernels that call it are given its `part`.

    Args:
        function, digest, options: as of `Part`.
    """

    prefix = ""

    def __init__(self, function: Callable[..., Any], digest: str, options: dict[str, Any]) -> None:
        super().__init__(function, digest, options)
        self._absorbed = options.get("inline") == "always"
        self._part: Part | None = None

    @property
    def part(self) -> Part:
        """The second dispatcher, which makes no machine code."""
        if self._part is None:
            options = self.targetoptions | {"no_cpython_wrapper": True}
            self._part = Part(self.py_func, self.source_digest, options)
        return self._part

    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Return how another kernel calls this one with arguments of some types."""
        # A constant argument would be compiled for its value: a dozen copies of one small kernel.
        plain = tuple(map(types.unliteral, args))
        if self._absorbed:
            return super().get_call_template(plain, kws)
        return self.part.get_call_template(plain, kws)

    def get_overload(self, sig: Any) -> Any:
        """Return the function that another kernel calls, compiled for a signature."""
        return super().get_overload(sig) if self._absorbed else self.part.get_overload(sig)


@contextlib.contextmanager
def _no_collection() -> Iterator[None]:
    """Do not look for unreachable cycles meanwhile: a ninth of compiling is such a search."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()
