"""When machine code is made: once for each kernel that Python calls, with all that it calls.

numba links a function's code into each caller and makes machine code of it there again, and again
in the callers of these: a kernel ten calls deep is translated ten times. Here a kernel that
another kernel calls stays optimised LLVM code (a part), without machine code and without a wrapper
for Python, until a kernel that Python calls is finished. How code is optimised is numba's own way,
step by step: optimised but once, in the kernel that Python calls, the batch of chairs would be a
fifth slower.
"""

from __future__ import annotations

from typing import Any

import llvmlite.binding as llvm
from numba.core.codegen import JITCodeLibrary
from numba.core.environment import lookup_environment
from numba.core.registry import cpu_target

_ENVIRONMENT = "_ZN08NumbaEnv"  # how numba's names of environments begin


class _Library(JITCodeLibrary):
    """A library of which machine code is made only if Python calls it."""

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
            parent: Any = super()
            return parent._get_module_for_linking()
        self._merge()
        optimise: Any = self._optimize_final_module
        optimise()
        module = self._final_module.clone()
        for function in module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "linkonce_odr"
        self._shared_module = module
        return module

    def finalize(self) -> None:
        self._merge()
        self._linking_libraries = []
        parent: Any = super()
        parent.finalize()
        environment_of: Any = lookup_environment
        for variable in self._final_module.global_variables:
            if variable.name.startswith(_ENVIRONMENT):
                environment = environment_of(variable.name)
                if environment is not None:
                    self.codegen.set_env(variable.name, environment)

    def get_pointer_to_function(self, name: str) -> int:
        if not self._finalized and not self._defines(name):
            return 0  # a part: no wrapper, nothing that Python could call
        parent: Any = super()
        return int(parent.get_pointer_to_function(name))

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
            parent: Any = super()
            return parent.serialize_using_object_code()
        return self.name, "part", self._get_module_for_linking().as_bitcode()

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Any:
        name, kind, data = state
        if kind != "part":
            parent: Any = super()
            return parent._unserialize(codegen, state)
        self = codegen.create_library(name)
        self._final_module = llvm.parse_bitcode(data)
        self._merged = True
        self._shared_module = self._final_module
        return self


def install() -> None:
    """Let this process make machine code so, for every kernel compiled from now on."""
    codegen = cpu_target.target_context.codegen()
    set_env = codegen.set_env

    def set_env_if_made(name: str, environment: Any) -> None:
        if codegen._engine.is_symbol_defined(name):
            set_env(name, environment)

    codegen._library_class, codegen.set_env = _Library, set_env_if_made
