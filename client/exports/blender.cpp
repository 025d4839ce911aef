// Blender: https://docs.blender.org/manual, "Volume Scatter", "Volume Absorption", "Principled
// BSDF". How colour and density become coefficients, which the manual does not say, is taken from
// Cycles: svm_node_closure_volume() in intern/cycles/kernel/svm/closure.h,
//   sigma_s = color * density (Volume Scatter),  sigma_a = (1 - color) * density (Volume
//   Absorption)
// in the reciprocal of Blender units. Subsurface scattering: bssrdf_setup() and
// bssrdf_setup_radius() in kernel/closure/bssrdf.h and subsurface_random_walk_remap() in
// kernel/integrator/subsurface_random_walk.h,
//   sigma_t (1 - g) = 4 pi / radius, with g clamped to [0, 0.9].
#include <fmt/format.h>

#include "client/exports/exports.h"
#include "client/exports/file_text.h"

namespace itn {
namespace {

constexpr std::string_view kScript = R"(
# True: a Principled BSDF with subsurface scattering in place of the volume. Renders faster, also in
# EEVEE, but is an approximation.
AS_SUBSURFACE = False


def per_blender_unit(sigma):
    return [MM_PER_BLENDER_UNIT * channel for channel in sigma]


def new_node(tree, kind, **inputs):
    node = tree.nodes.new(kind)
    for name, value in inputs.items():
        node.inputs[name.replace("_", " ")].default_value = value
    return node


def make_volume(tree, output):
    """Scatters color * density, and absorbs (1 - color) * density."""
    sigma_a, sigma_s = per_blender_unit(SIGMA_A), per_blender_unit(SIGMA_S)
    most_a, most_s = max(sigma_a), max(sigma_s)
    scatter = new_node(tree, "ShaderNodeVolumeScatter", Density=most_s, Anisotropy=G,
                       Color=[channel / (most_s or 1) for channel in sigma_s] + [1])
    absorption = new_node(tree, "ShaderNodeVolumeAbsorption", Density=most_a,
                          Color=[1 - channel / (most_a or 1) for channel in sigma_a] + [1])
    both = new_node(tree, "ShaderNodeAddShader")
    tree.links.new(scatter.outputs["Volume"], both.inputs[0])
    tree.links.new(absorption.outputs["Volume"], both.inputs[1])
    tree.links.new(both.outputs["Shader"], output.inputs["Volume"])
    if INDEX != 1:
        glass = new_node(tree, "ShaderNodeBsdfGlass", Color=[1, 1, 1, 1], IOR=INDEX,
                         Roughness=math.sqrt(ALPHA))
        glass.distribution = "MULTI_GGX"  # light that meets several microfacets is not lost
        tree.links.new(glass.outputs["BSDF"], output.inputs["Surface"])


def diffuse_albedo(sigma_a, sigma_s_reduced):
    """Van de Hulst's, of a half-space."""
    s = math.sqrt(sigma_a / (sigma_a + sigma_s_reduced))
    return (1 - s) * (1 - 0.139 * s) / (1 + 1.17 * s)


def make_subsurface(tree, output):
    """For Blender 4.0 and later."""
    g = min(max(G, 0), 0.9)  # as Cycles clamps it
    sigma_a = per_blender_unit(SIGMA_A)
    reduced = [channel * (1 - G) for channel in per_blender_unit(SIGMA_S)]
    surface = new_node(
        tree, "ShaderNodeBsdfPrincipled", Roughness=math.sqrt(ALPHA) if INDEX != 1 else 1,
        IOR=INDEX, Specular_IOR_Level=0.5 if INDEX != 1 else 0, Subsurface_Weight=1,
        Base_Color=[diffuse_albedo(a, s) for a, s in zip(sigma_a, reduced)] + [1],
        Subsurface_Radius=[4 * math.pi / (a * (1 - g) + s) for a, s in zip(sigma_a, reduced)],
        Subsurface_Scale=1, Subsurface_Anisotropy=g)
    surface.subsurface_method = "RANDOM_WALK"
    tree.links.new(surface.outputs["BSDF"], output.inputs["Surface"])


def make_material():
    material = bpy.data.materials.new(NAME)
    if material.node_tree is None:  # before Blender 5.0
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    output = new_node(tree, "ShaderNodeOutputMaterial")
    if AS_SUBSURFACE:
        make_subsurface(tree, output)
    else:
        make_volume(tree, output)
    return material


make_material()
)";

}  // namespace

std::string to_blender(const RgbMaterial& material, const ExportOptions& options) {
  const RgbMaterial real = of_object(material, options);
  std::vector<std::string> comment = heading(options, "divide SIGMA_A and SIGMA_S by S");
  comment.insert(
      comment.end(),
      {"", "Run it in Blender's Text Editor, or by blender scene.blend --python FILE, and",
       "assign the new material to a closed mesh. In Cycles set Max Bounces, Total and Volume,",
       "to 1024: what they are at first leaves out most light."});
  return hash_comment(comment) +
         fmt::format(
             "import math\n\n"
             "import bpy\n\n"
             "NAME = \"{}\"\n"
             "SIGMA_A = ({})  # absorption coefficients of R, G, B in 1/mm\n"
             "SIGMA_S = ({})  # scattering coefficients, likewise\n"
             "G = {}  # mean cosine of the phase function\n"
             "INDEX = {}  # of refraction; 1: the surface neither reflects nor refracts\n"
             "ALPHA = {}  # of GGX: Blender's roughness is its root\n"
             "# 1000 * bpy.context.scene.unit_settings.scale_length, if the scene is in its "
             "units.\n"
             "MM_PER_BLENDER_UNIT = {}\n",
             identifier(options), numbers(real.sigma_a, ", "), numbers(real.sigma_s, ", "),
             number(material.g), number(options.boundary ? options.boundary->index : 1),
             number(options.boundary ? options.boundary->roughness : 0),
             number(options.mm_per_scene_unit)) +
         std::string(kScript);
}

}  // namespace itn
