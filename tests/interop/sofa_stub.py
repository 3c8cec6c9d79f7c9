"""A stand-in for SofaPython3 that remembers which components a scene asks for."""

import types
from typing import Any

import numpy as np


class Data:
    def __init__(self, value: Any) -> None:
        self.value = value


class Component:
    def __init__(self, kind: str, path: str, settings: dict[str, Any]) -> None:
        self.kind, self.path, self.settings = kind, path, settings
        self.data = {name: Data(np.array(settings.get("position", []))) for name in ("position", "rest_position")}
        self.data |= {"lambda": Data(np.zeros((0, 3))), "constraint": Data("")}

    def findData(self, name: str) -> Data:
        return self.data[name]

    def getLinkPath(self) -> str:
        return "@" + self.path


class Controller:
    def __init__(self, *args: Any, **kwargs: Any) -> None:
        pass


class Node:
    def __init__(self, name: str, path: str = "") -> None:
        self.name, self.path = name, f"{path}/{name}"
        self.children: list[Node] = []
        self.objects: list[Any] = []

    def addObject(self, kind: Any, **settings: Any) -> Any:
        made = Component(kind, f"{self.path}/{settings.get('name', kind)}", settings) if isinstance(kind, str) else kind
        self.objects.append(made)
        if "name" in settings:
            setattr(self, settings["name"], made)
        return made

    def addChild(self, child: Any) -> "Node":
        node = Node(child, self.path) if isinstance(child, str) else child
        self.children.append(node)
        return node

    def all(self) -> list[Any]:
        """Components of this node and all below, each once."""
        found = list(self.objects)
        for child in self.children:
            found += [item for item in child.all() if item not in found]
        return found

    def kinds(self) -> list[str]:
        return [item.kind for item in self.all() if isinstance(item, Component)]

    def find(self, kind: str) -> list[Component]:
        return [item for item in self.all() if isinstance(item, Component) and item.kind == kind]


def modules(animate: Any) -> dict[str, types.ModuleType]:
    """Stand-ins for Sofa, Sofa.Core and Sofa.Simulation; `animate(root)` computes a frame."""
    sofa, core, simulation = (types.ModuleType(name) for name in ("Sofa", "Sofa.Core", "Sofa.Simulation"))
    core.Controller, core.Node = Controller, Node

    def frame(root: Node, time_step: float) -> None:
        controllers = [item for item in root.objects if isinstance(item, Controller)]
        for controller in controllers:
            controller.onAnimateBeginEvent(None)
        animate(root)
        for controller in controllers:
            controller.onAnimateEndEvent(None)

    simulation.animate, simulation.initRoot, simulation.unload = frame, lambda root: None, lambda root: None
    sofa.Core, sofa.Simulation = core, simulation
    return {"Sofa": sofa, "Sofa.Core": core, "Sofa.Simulation": simulation}
