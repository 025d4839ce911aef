"""Stands in for Blender's module: records the nodes that a script makes, and prints at its end the
coefficients that they mean to Cycles, one "name = R G B" a line."""
import atexit
import math


class Socket:
    def __init__(self, default_value=None):
        self.default_value = default_value


# The inputs of each kind with what Blender 5.0 has in them at first; the outputs.
KINDS = {
    "ShaderNodeOutputMaterial": ({"Surface": None, "Volume": None}, []),
    "ShaderNodeVolumeScatter": (
        {"Color": (.8, .8, .8, 1), "Density": 1., "Anisotropy": 0.}, ["Volume"]),
    "ShaderNodeVolumeAbsorption": ({"Color": (.8, .8, .8, 1), "Density": 1.}, ["Volume"]),
    "ShaderNodeBsdfGlass": (
        {"Color": (1, 1, 1, 1), "Roughness": 0., "IOR": 1.5}, ["BSDF"]),
    "ShaderNodeAddShader": ({0: None, 1: None}, ["Shader"]),
    "ShaderNodeBsdfPrincipled": (
        {"Base Color": (.8, .8, .8, 1), "Roughness": .5, "IOR": 1.5, "Specular IOR Level": .5,
         "Subsurface Weight": 0., "Subsurface Radius": (1., .2, .1), "Subsurface Scale": .05,
         "Subsurface Anisotropy": 0.}, ["BSDF"]),
}


class Node:
    def __init__(self, kind):
        inputs, outputs = KINDS[kind]
        self.kind = kind
        self.inputs = {name: Socket(value) for name, value in inputs.items()}
        self.outputs = {name: Socket() for name in outputs}
        for output in self.outputs.values():
            output.node = self

    def __getitem__(self, name):
        return self.inputs[name].default_value


class Nodes(list):
    def new(self, kind):
        self.append(Node(kind))
        return self[-1]


class Links:
    def new(self, output, to_input):
        to_input.source = output.node


class Tree:
    def __init__(self):
        self.nodes = Nodes()
        self.links = Links()


class Material:
    """As before Blender 5.0: without nodes at first."""

    def __init__(self, name):
        self.name = name
        self.node_tree = None

    def __setattr__(self, name, value):
        if name == "use_nodes" and value:
            name, value = "node_tree", Tree()
            value.nodes.new("ShaderNodeBsdfPrincipled")
        super().__setattr__(name, value)


class Materials(list):
    def new(self, name):
        self.append(Material(name))
        return self[-1]


class data:
    materials = Materials()


def coefficients(volume):
    """sigma_a, sigma_s, g of what is linked to the volume output."""
    if volume.kind == "ShaderNodeAddShader":
        a, b = (coefficients(volume.inputs[i].source) for i in (0, 1))
        return [x + y for x, y in zip(a[0], b[0])], [x + y for x, y in zip(a[1], b[1])], a[2] + b[2]
    red_green_blue = list(volume["Color"])[:3]
    assert len(volume["Color"]) == 4 and all(0 <= channel <= 1 for channel in red_green_blue)
    if volume.kind == "ShaderNodeVolumeScatter":
        return [0] * 3, [c * volume["Density"] for c in red_green_blue], volume["Anisotropy"]
    assert volume.kind == "ShaderNodeVolumeAbsorption"
    return [(1 - c) * volume["Density"] for c in red_green_blue], [0] * 3, 0


def show(name, values):
    print(name, "=", *values)


def show_subsurface(surface):
    assert surface["Subsurface Weight"] == 1 and surface["Specular IOR Level"] == 0
    assert surface.subsurface_method == "RANDOM_WALK"
    g = surface["Subsurface Anisotropy"]
    show("diffuse_albedo", list(surface["Base Color"])[:3])
    show("sigma_t", [4 * math.pi / (radius * surface["Subsurface Scale"] * (1 - g))
                     for radius in surface["Subsurface Radius"]])
    show("g", [g])


def show_material():
    material, = data.materials
    output, = (node for node in material.node_tree.nodes
               if node.kind == "ShaderNodeOutputMaterial")
    show("name", [material.name])
    surface = getattr(output.inputs["Surface"], "source", None)
    if surface and surface.kind == "ShaderNodeBsdfPrincipled":
        return show_subsurface(surface)
    if surface:
        assert surface.kind == "ShaderNodeBsdfGlass" and surface.distribution == "MULTI_GGX"
        assert list(surface["Color"]) == [1] * 4
        show("index", [surface["IOR"]])
        show("roughness", [surface["Roughness"]])
    sigma_a, sigma_s, g = coefficients(output.inputs["Volume"].source)
    show("sigma_a", sigma_a)
    show("sigma_s", sigma_s)
    show("g", [g])


atexit.register(show_material)
