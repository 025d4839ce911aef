#include "client/exports/exports.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <clocale>
#include <cmath>
#include <map>
#include <regex>
#include <sstream>
#include <vector>

#include <pugixml.hpp>

#include "common/error.h"
#include "tests/support/expect_error.h"
#include "tests/support/paths.h"
#include "tests/support/process.h"
#include "tests/support/temporary_folder.h"

namespace itn {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using namespace std::string_literals;

using Rgb = std::array<double, 3>;

// Read back from a file, by what the renderer's documentation says that its parameters mean.
struct Medium {
  Rgb sigma_a{}, sigma_s{};  // in the reciprocal of scene units
  double g = 0;
};

std::vector<double> parse_numbers(std::string text) {
  std::ranges::replace(text, ',', ' ');
  std::istringstream stream(text);
  stream.imbue(std::locale::classic());
  std::vector<double> values;
  for (double value = 0; stream >> value;) values.push_back(value);
  EXPECT_TRUE(stream.eof()) << text;
  return values;
}

Rgb parse_rgb(const std::string& text) {
  const std::vector<double> values = parse_numbers(text);
  if (values.size() == 1) return {values[0], values[0], values[0]};
  EXPECT_EQ(values.size(), 3u) << text;
  return {values.at(0), values.at(1), values.at(2)};
}

// What the only match of the pattern has between its parentheses.
std::string only_match(const std::string& text, const std::string& pattern) {
  const std::regex regex(pattern);
  const std::sregex_iterator first(text.begin(), text.end(), regex), end;
  EXPECT_EQ(std::distance(first, end), 1) << pattern << " in\n" << text;
  return first == end ? "" : (*first)[1].str();
}

// ---- XML

pugi::xml_document parse_xml(const std::string& text) {
  pugi::xml_document document;
  const auto result =
      document.load_string(text.c_str(), pugi::parse_default | pugi::parse_comments);
  if (!result) throw std::runtime_error(result.description());
  return document;
}

// The element below this one whose attribute `key` has the value.
pugi::xml_node child(const pugi::xml_node& parent, const std::string& key,
                     const std::string& value) {
  const pugi::xml_node found = parent.find_child(
      [&](const pugi::xml_node& node) { return node.attribute(key.c_str()).value() == value; });
  if (!found) throw std::runtime_error("no " + key + "=" + value + " in " + parent.name());
  return found;
}

std::string value(const pugi::xml_node& parent, const std::string& name) {
  return child(parent, "name", name).attribute("value").value();
}

// ---- What the parameters mean.

Medium from_albedo(const Rgb& sigma_t, const Rgb& albedo, double g) {
  Medium medium{.g = g};
  for (size_t c = 0; c < 3; ++c) {
    medium.sigma_a[c] = sigma_t[c] * (1 - albedo[c]);
    medium.sigma_s[c] = sigma_t[c] * albedo[c];
  }
  return medium;
}

// Mitsuba 3, "Homogeneous medium": `scale` multiplies sigma_t; RGB values are in [0, 1].
Medium read_mitsuba(const std::string& text) {
  const pugi::xml_document xml = parse_xml(text);
  const pugi::xml_node scene = xml.child("scene");
  const pugi::xml_node medium = child(scene, "type", "homogeneous");
  const double scale = parse_numbers(value(medium, "scale")).at(0);
  Rgb sigma_t = parse_rgb(value(medium, "sigma_t"));
  for (double& channel : sigma_t) {
    EXPECT_TRUE(child(medium, "name", "sigma_t").name() != "rgb"s || channel <= 1);
    channel *= scale;
  }
  return from_albedo(sigma_t, parse_rgb(value(medium, "albedo")),
                     parse_numbers(value(child(medium, "type", "hg"), "g")).at(0));
}

// pbrt-v4, HomogeneousMedium::Create(): `scale` multiplies both.
Medium read_pbrt(const std::string& text) {
  const std::string code = std::regex_replace(text, std::regex("#[^\n]*\n"), "\n");
  const auto parameter = [&](const std::string& name) {
    return only_match(code, "\"" + name + "\" (?:\\[ ([^\\]]*) \\])");
  };
  const auto scalar = [&](const std::string& name) {
    return parse_numbers(only_match(code, "\"" + name + "\" ([^\\s\\[]+)\\s*\n")).at(0);
  };
  EXPECT_EQ(only_match(code, "MakeNamedMedium \"[^\"]*\"\\s+\"string type\" \"([^\"]*)\""),
            "homogeneous");
  Medium medium{parse_rgb(parameter("rgb sigma_a")), parse_rgb(parameter("rgb sigma_s")),
                scalar("float g")};
  for (size_t c = 0; c < 3; ++c) {
    medium.sigma_a[c] *= scalar("float scale");
    medium.sigma_s[c] *= scalar("float scale");
  }
  return medium;
}

// What the script does, run beside a stand-in for Blender's module.
std::map<std::string, std::string> run_blender(const std::string& script) {
  const testing::TemporaryFolder folder;
  const testing::Finished finished = testing::run(
      {"/usr/bin/env", "PYTHONDONTWRITEBYTECODE=1",
       std::string("PYTHONPATH=") + testing::source("tests/client/exports/blender_stand_in"),
       "python3", folder.write("material.py", script).string()});
  EXPECT_EQ(finished.exit_code, 0) << finished.errors;
  std::map<std::string, std::string> said;
  std::istringstream lines(finished.output);
  for (std::string line; std::getline(lines, line);) {
    const size_t equals = line.find(" = ");
    said[line.substr(0, equals)] = line.substr(equals + 3);
  }
  return said;
}

Medium read_blender(const std::string& text) {
  const auto said = run_blender(text);
  return {parse_rgb(said.at("sigma_a")), parse_rgb(said.at("sigma_s")),
          parse_numbers(said.at("g")).at(0)};
}

// OpenPBR Surface 1.1, "Translucent base", also for Arnold.
Medium from_transmission(const Rgb& color, double depth, const Rgb& scatter, double g) {
  Medium medium{.g = g};
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_LE(scatter[c], 1);
    medium.sigma_s[c] = scatter[c] / depth;
    medium.sigma_a[c] = -std::log(color[c]) / depth - medium.sigma_s[c];
  }
  return medium;
}

Medium read_arnold(const std::string& text) {
  const std::string code = std::regex_replace(text, std::regex("#[^\n]*\n"), "");
  const auto parameter = [&](const std::string& name) {
    return only_match(code, "\n " + name + " ([^\n]*)\n");
  };
  EXPECT_EQ(parameter("transmission"), "1");
  return from_transmission(parse_rgb(parameter("transmission_color")),
                           parse_numbers(parameter("transmission_depth")).at(0),
                           parse_rgb(parameter("transmission_scatter")),
                           parse_numbers(parameter("transmission_scatter_anisotropy")).at(0));
}

Medium read_openpbr_transmission(const std::string& text) {
  const pugi::xml_document xml = parse_xml(text);
  const pugi::xml_node shader = child(xml.document_element(), "name", "jade_volume_shader");
  EXPECT_EQ(value(shader, "transmission_weight"), "1");
  return from_transmission(parse_rgb(value(shader, "transmission_color")),
                           parse_numbers(value(shader, "transmission_depth")).at(0),
                           parse_rgb(value(shader, "transmission_scatter")),
                           parse_numbers(value(shader, "transmission_scatter_anisotropy")).at(0));
}

// OpenPBR Surface 1.1, "Subsurface": from the diffuse albedo C to the albedo. The specification
// prints the solution of its equation for s with 6 digits; this is the same root without rounding.
double albedo_of(double color, double g) {
  const double a = .139, b = 1.139 + 1.17 * color, c = 1 - color;
  const double s = 2 * c / (b + std::sqrt(b * b - 4 * a * c));
  return (1 - s * s) / (1 - g * s * s);
}

Medium read_openpbr_subsurface(const std::string& text) {
  const pugi::xml_document xml = parse_xml(text);
  const pugi::xml_node shader = child(xml.document_element(), "name", "jade_shader");
  EXPECT_EQ(value(shader, "subsurface_weight"), "1");
  const double g = parse_numbers(value(shader, "subsurface_scatter_anisotropy")).at(0);
  const double radius = parse_numbers(value(shader, "subsurface_radius")).at(0);
  Rgb sigma_t = parse_rgb(value(shader, "subsurface_radius_scale"));
  Rgb albedo = parse_rgb(value(shader, "subsurface_color"));
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_LE(sigma_t[c], 1);
    sigma_t[c] = 1 / (radius * sigma_t[c]);
    albedo[c] = albedo_of(albedo[c], g);
  }
  return from_albedo(sigma_t, albedo, g);
}

// ---- What bounds it: index and alpha of GGX, as the renderer's documentation says.

struct Boundary {
  double index = 1, alpha = 0;
};

Boundary mitsuba_boundary(const std::string& text) {
  const pugi::xml_document xml = parse_xml(text);
  const pugi::xml_node bsdf = child(xml.child("scene"), "id", "jade_boundary");
  const std::string type = bsdf.attribute("type").value();
  if (type == "null") return {};
  EXPECT_EQ(value(bsdf, "ext_ior"), "1");
  const double index = parse_numbers(value(bsdf, "int_ior")).at(0);
  if (type == "dielectric") return {index, 0};
  EXPECT_EQ(type, "roughdielectric");
  EXPECT_EQ(value(bsdf, "distribution"), "ggx");
  return {index, parse_numbers(value(bsdf, "alpha")).at(0)};
}

// Without the remapping that pbrt does unless told not to, its roughness is alpha.
Boundary pbrt_boundary(const std::string& text) {
  const std::string code = std::regex_replace(text, std::regex("#[^\n]*\n"), "\n");
  if (code.find("\"jade_boundary\" \"string type\" \"interface\"") != std::string::npos) return {};
  EXPECT_EQ(only_match(code, "MakeNamedMaterial \"jade_boundary\"\\s+\"string type\" \"(.*)\""),
            "dielectric");
  EXPECT_EQ(only_match(code, "\"bool remaproughness\" (.*)\n"), "false");
  return {parse_numbers(only_match(code, "\"float eta\" (.*)\n")).at(0),
          parse_numbers(only_match(code, "\"float roughness\" (.*)\n")).at(0)};
}

// Cycles squares a roughness.
Boundary blender_boundary(const std::string& text) {
  const auto said = run_blender(text);
  if (!said.contains("index")) return {};
  return {parse_numbers(said.at("index")).at(0),
          std::pow(parse_numbers(said.at("roughness")).at(0), 2)};
}

// So do Arnold and OpenPBR.
Boundary arnold_boundary(const std::string& text) {
  const std::string code = std::regex_replace(text, std::regex("#[^\n]*\n"), "");
  const auto parameter = [&](const std::string& name) {
    return parse_numbers(only_match(code, "\n " + name + " ([^\n]*)\n")).at(0);
  };
  const double index = parameter("specular_IOR");
  if (parameter("specular") == 0) return {index, 0};
  return {index, std::pow(parameter("specular_roughness"), 2)};
}

template <const char* kShader>
Boundary openpbr_boundary(const std::string& text) {
  const pugi::xml_document xml = parse_xml(text);
  const pugi::xml_node shader = child(xml.document_element(), "name", kShader);
  const double index = parse_numbers(value(shader, "specular_ior")).at(0);
  if (value(shader, "specular_weight") == "0") return {index, 0};
  return {index, std::pow(parse_numbers(value(shader, "specular_roughness")).at(0), 2)};
}
constexpr char kSubsurface[] = "jade_shader", kTransmission[] = "jade_volume_shader";

// ---- Every format, unit and kind of material.

struct Reader {
  const char* name;
  std::string (*write)(const RgbMaterial&, const ExportOptions&);
  Medium (*read)(const std::string&);
  Boundary (*read_boundary)(const std::string&);
};

void PrintTo(const Reader& reader, std::ostream* stream) {
  *stream << reader.name;
}

const std::vector<Reader> kReaders{
    {"mitsuba", to_mitsuba, read_mitsuba, mitsuba_boundary},
    {"pbrt", to_pbrt, read_pbrt, pbrt_boundary},
    {"blender", to_blender, read_blender, blender_boundary},
    {"arnold", to_arnold, read_arnold, arnold_boundary},
    {"openpbr_subsurface", to_openpbr, read_openpbr_subsurface, openpbr_boundary<kSubsurface>},
    {"openpbr_transmission", to_openpbr, read_openpbr_transmission,
     openpbr_boundary<kTransmission>},
};

const std::vector<std::vector<Material>> kMaterials{
    {{43.2178391, .8734591, .4123456}},
    {{8.12345678, .99, -.3}},
    {{40.1234567, .9, .6}, {70.7654321, .95, .3}, {25.2525252, .5, -.2}},
    {{271.828183, .97, .8}, {314.159265, .3, 0}, {.5, .8, .95}},
};

class Export : public ::testing::TestWithParam<Reader> {};

std::string all_comments(const std::string& text) {
  std::string comments;
  if (text.starts_with("<?xml")) {
    const pugi::xml_document xml = parse_xml(text);
    for (const auto& comment : xml.select_nodes("//comment()")) comments += comment.node().value();
    EXPECT_THAT(comments, Not(HasSubstr("--")));
    return comments;
  }
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("#")) comments += line + "\n";
  }
  return comments;
}

TEST_P(Export, ReadBackIsTheMedium) {
  for (const auto& channels : kMaterials) {
    const RgbMaterial material = rgb_material(channels);
    for (const auto& [mm_per_scene_unit, object_size_mm] :
         std::vector<std::pair<double, std::optional<double>>>{
             {1, {}}, {10, {}}, {1000, {}}, {25.4, 132.5}, {1000, 40.}}) {
      const ExportOptions options{"jade", mm_per_scene_unit, object_size_mm, "test"};
      const std::string text = GetParam().write(material, options);
      SCOPED_TRACE(text);
      const Medium medium = GetParam().read(text);
      // A 1 mm object of coefficient sigma is like one of L mm with sigma / L.
      const double factor = mm_per_scene_unit / object_size_mm.value_or(1);
      EXPECT_NEAR(medium.g, material.g, 1e-5 * std::abs(material.g));
      for (size_t c = 0; c < 3; ++c) {
        const double sigma_a = material.sigma_a[c] * factor, sigma_s = material.sigma_s[c] * factor;
        EXPECT_NEAR(medium.sigma_a[c], sigma_a, 1e-5 * sigma_a) << c;
        EXPECT_NEAR(medium.sigma_s[c], sigma_s, 1e-5 * sigma_s) << c;
      }
    }
  }
}

TEST_P(Export, ReadBackHasItsBoundary) {
  const RgbMaterial material = rgb_material(kMaterials[2]);
  const Boundary none =
      GetParam().read_boundary(GetParam().write(material, {.name = "jade", .boundary = {}}));
  EXPECT_EQ(none.index, 1);
  EXPECT_EQ(none.alpha, 0);
  for (const double roughness : {0., 0.25}) {
    const ExportOptions options{.name = "jade", .boundary = ExportBoundary{1.37, roughness}};
    const std::string text = GetParam().write(material, options);
    SCOPED_TRACE(text);
    const Boundary boundary = GetParam().read_boundary(text);
    EXPECT_NEAR(boundary.index, 1.37, 1e-6);
    EXPECT_NEAR(boundary.alpha, roughness, 1e-6);
    EXPECT_THAT(all_comments(text), HasSubstr("index of refraction 1.37, roughness "));
    EXPECT_NEAR(GetParam().read(text).sigma_s[1], material.sigma_s[1], 1e-5 * material.sigma_s[1]);
  }
  for (const ExportBoundary& wrong : {ExportBoundary{0.9, 0}, ExportBoundary{1.5, 1.1}}) {
    testing::expect_error(ErrorKind::kInvalidInput, {"boundary."},
                          [&] { GetParam().write(material, {.boundary = wrong}); });
  }
}

// Coefficients that are the medium's own stay, and nothing is said of a size.
TEST_P(Export, OfAnySizeHasTheCoefficients) {
  const RgbMaterial material = rgb_material(kMaterials[2]);
  const std::string text =
      GetParam().write(material, {.name = "jade", .mm_per_scene_unit = 10, .any_size = true});
  EXPECT_NEAR(GetParam().read(text).sigma_s[0], 10 * material.sigma_s[0], 1e-2);
  EXPECT_THAT(all_comments(text), HasSubstr("for objects of any size"));
  EXPECT_THAT(all_comments(text), Not(HasSubstr("unknown")));
}

TEST_P(Export, TakesWhatOnlyScattersAndWhatOnlyAbsorbs) {
  for (const double albedo : {0., 1.}) {
    const RgbMaterial material = rgb_material(std::vector<Material>{{30, albedo, 0}});
    const Medium medium = GetParam().read(GetParam().write(material, {.name = "jade"}));
    EXPECT_NEAR(medium.sigma_a[1], 30 * (1 - albedo), 3e-4);
    EXPECT_NEAR(medium.sigma_s[1], 30 * albedo, 3e-4);
  }
}

TEST_P(Export, SaysUnitSizeAndOrigin) {
  const RgbMaterial material = rgb_material(kMaterials.back());
  const std::string known =
      all_comments(GetParam().write(material, {"jade", 10, 25., "model outdoor, image a.exr"}));
  EXPECT_THAT(known, HasSubstr("1 scene unit = 10 mm"));
  EXPECT_THAT(known, HasSubstr("longest side of the object: 25 mm (2.5 scene units)"));
  EXPECT_THAT(known, HasSubstr("from model outdoor, image a.exr"));
  const std::string unknown = all_comments(GetParam().write(material, {"jade", 10, {}, ""}));
  EXPECT_THAT(unknown, HasSubstr("size is unknown"));
  EXPECT_THAT(unknown, HasSubstr("longest side of 1 mm (0.1 scene units)"));
  EXPECT_THAT(unknown, HasSubstr("If it is S mm, "));
}

// What the comment says to do for another size is what leads to the file for that size.
TEST_P(Export, RescaledByHandIsTheFileForThatSize) {
  const RgbMaterial material = rgb_material(kMaterials[2]);
  std::string text = GetParam().write(material, {.name = "jade"});
  const auto rewrite = [&](const std::string& before, double factor) {
    const std::regex pattern("(" + before + ")([-+.e0-9]+)");
    std::smatch match;
    ASSERT_TRUE(std::regex_search(text, match, pattern)) << before;
    const std::string value = std::to_string(std::stod(match[2]) * factor);
    text = match.prefix().str() + match[1].str() + value + match.suffix().str();
  };
  const std::string advice = only_match(all_comments(text), "If it is S mm, ([^\n]*)\\.");
  if (advice == "divide 'scale' by S") {
    rewrite("name=\"scale\" value=\"", 1 / 40.);
  } else if (advice == "divide \"scale\" by S") {
    rewrite("float scale\" ", 1 / 40.);
  } else if (advice == "divide SIGMA_A and SIGMA_S by S") {
    for (const std::string name : {"SIGMA_A", "SIGMA_S"}) {
      rewrite("\n" + name + " = \\(", 1 / 40.);
      rewrite("\n" + name + " = \\([^,]*, ", 1 / 40.);
      rewrite("\n" + name + " = \\([^,]*, [^,]*, ", 1 / 40.);
    }
  } else if (advice == "multiply transmission_depth and subsurface_scale by S") {
    rewrite("\n transmission_depth ", 40);
  } else {
    ASSERT_EQ(advice, "multiply subsurface_radius and transmission_depth by S");
    rewrite("subsurface_radius\" type=\"float\" value=\"", 40);
    rewrite("transmission_depth\" type=\"float\" value=\"", 40);
  }
  const Medium by_hand = GetParam().read(text);
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(by_hand.sigma_a[c], material.sigma_a[c] / 40, 1e-4 * material.sigma_a[c] / 40);
    EXPECT_NEAR(by_hand.sigma_s[c], material.sigma_s[c] / 40, 1e-4 * material.sigma_s[c] / 40);
  }
}

// Names and origins come from strangers.
TEST_P(Export, OfAnyNameAndOriginIsWellFormed) {
  const RgbMaterial material = rgb_material(kMaterials[2]);
  const Medium plain = GetParam().read(GetParam().write(material, {.name = "jade"}));
  for (const std::string& hostile :
       {std::string("a--b--->c-- -"), std::string("]]>&lt;<x y=\"z\"/>'\""),
        std::string("\"\"\"\n}\nimport os\n# x\\"),
        std::string("$name \xff\xc3\xa4\0\x1b[2J\r\n", 15), std::string("-"),
        std::string(5000, '-')}) {
    const std::string text = GetParam().write(material, {.name = "jade", .provenance = hostile});
    SCOPED_TRACE(text);
    EXPECT_EQ(GetParam().read(text).sigma_s, plain.sigma_s);
    EXPECT_LT(text.size(), 10000u);
    for (const char c : text) EXPECT_TRUE(c == '\n' || (c >= ' ' && c <= '~')) << int{c};

    const std::string named = GetParam().write(material, {.name = hostile});
    EXPECT_EQ(std::regex_replace(named, std::regex("_[A-Za-z0-9_]*|[a-z][A-Za-z0-9_]*"), ""),
              std::regex_replace(GetParam().write(material, {.name = "jade"}),
                                 std::regex("_[A-Za-z0-9_]*|[a-z][A-Za-z0-9_]*"), ""));
  }
}

TEST_P(Export, DoesNotDependOnTheLocale) {
  const RgbMaterial material = rgb_material(kMaterials[2]);
  const std::string before = GetParam().write(material, {});
  struct CommaForPoint : std::numpunct<char> {
    char do_decimal_point() const override { return ','; }
  };
  const std::locale other(std::locale::classic(), new CommaForPoint);
  const std::locale previous = std::locale::global(other);
  const std::string after = GetParam().write(material, {});
  std::locale::global(previous);
  EXPECT_EQ(after, before);
}

TEST_P(Export, RefusesLengthsThatAreNone) {
  const RgbMaterial material = rgb_material(kMaterials[0]);
  for (const double length : {0., -1., std::nan(""), HUGE_VAL}) {
    testing::expect_error(ErrorKind::kInvalidInput, {"mm_per_scene_unit", "positive"},
                          [&] { GetParam().write(material, {.mm_per_scene_unit = length}); });
    testing::expect_error(ErrorKind::kInvalidInput, {"object_size_mm", "positive"},
                          [&] { GetParam().write(material, {.object_size_mm = length}); });
  }
}

INSTANTIATE_TEST_SUITE_P(Formats, Export, ::testing::ValuesIn(kReaders),
                         [](const auto& test) { return std::string(test.param.name); });

TEST(ExportFormats, AreFoundByName) {
  std::vector<std::string_view> names;
  for (const ExportFormat& format : export_formats()) {
    names.push_back(format.name);
    EXPECT_EQ(&export_format(format.name), &format);
    EXPECT_TRUE(format.extension.starts_with("."));
    EXPECT_THAT(std::string(format.description), Not(HasSubstr("\n")));
  }
  EXPECT_THAT(names, ElementsAre("mitsuba", "pbrt", "blender", "arnold", "openpbr"));
  testing::expect_error(ErrorKind::kUsage, {"vray", "mitsuba, pbrt, blender, arnold, openpbr"},
                        [] { export_format("vray"); });
}

TEST(Mitsuba, HasScalarsForGray) {
  const RgbMaterial material = rgb_material(kMaterials[0]);
  EXPECT_THAT(to_mitsuba(material, {}), Not(HasSubstr("<rgb")));
  EXPECT_THAT(to_mitsuba(rgb_material(kMaterials[2]), {}), HasSubstr("<rgb name=\"sigma_t\""));
}

// OpenPBR's formula as it is printed, whose constants have 6 digits.
TEST(OpenPbr, ColourLeadsToTheAlbedoByTheSpecificationsFormula) {
  for (const double g : {-.5, 0., .7}) {
    for (const double albedo : {.1, .5, .9, .99}) {
      const double c = rgb_material(std::vector<Material>{{1, albedo, g}}).diffuse_albedo(0);
      const double s = 4.09712 + 4.20863 * c - std::sqrt(9.59217 + 41.6808 * c + 17.7126 * c * c);
      EXPECT_NEAR((1 - s * s) / (1 - g * s * s), albedo, 2e-5) << g << " " << albedo;
    }
  }
}

// Lengths say their unit where MaterialX has a name for it and the object's size is known.
TEST(OpenPbr, LengthsSayTheirUnit) {
  const RgbMaterial material = rgb_material(kMaterials[0]);
  const auto unit_of = [&](double mm_per_scene_unit, std::optional<double> object_size_mm) {
    const std::string text = to_openpbr(
        material, {.mm_per_scene_unit = mm_per_scene_unit, .object_size_mm = object_size_mm});
    const std::string depth = only_match(text, "name=\"transmission_depth\"(.*)/>");
    EXPECT_EQ(
        only_match(depth, " value=\"[^\"]*\"(.*)"),
        only_match(only_match(text, "name=\"subsurface_radius\"(.*)/>"), " value=\"[^\"]*\"(.*)"));
    return only_match(depth, " value=\"[^\"]*\"(.*)");
  };
  EXPECT_EQ(unit_of(1, 50), " unittype=\"distance\" unit=\"millimeter\"");
  EXPECT_EQ(unit_of(10, 50), " unittype=\"distance\" unit=\"centimeter\"");
  EXPECT_EQ(unit_of(1000, 50), " unittype=\"distance\" unit=\"meter\"");
  EXPECT_EQ(unit_of(37, 50), "");
  EXPECT_EQ(unit_of(10, {}), "");
}

// The comment of the file has parameters of the same shader for subsurface scattering.
TEST(Arnold, OffersTheSameMediumAsSubsurface) {
  const RgbMaterial material = rgb_material(kMaterials[2]);
  const std::string text = to_arnold(material, {.name = "jade", .mm_per_scene_unit = 10});
  const auto parameter = [&](const std::string& name) {
    return only_match(text, "\n#  " + name + " ([^\n]*)\n");
  };
  const Rgb color = parse_rgb(parameter("subsurface_color"));
  const Rgb radius = parse_rgb(parameter("subsurface_radius"));
  for (size_t c = 0; c < 3; ++c) {
    EXPECT_NEAR(albedo_of(color[c], material.g), material.albedo(c), 1e-5);
    EXPECT_NEAR(radius[c] * parse_numbers(parameter("subsurface_scale")).at(0),
                material.mean_free_path(c) / 10, 1e-5 * material.mean_free_path(c));
  }
  EXPECT_NEAR(parse_numbers(parameter("subsurface_anisotropy")).at(0), material.g, 1e-6);
}

// Cycles takes a g in [0, 0.9] here; others become one of these by the similarity relation.
TEST(Blender, OffersASubsurfaceMaterialWithTheSameDiffusion) {
  for (const double g : {-.4, .5, .95}) {
    const RgbMaterial material =
        rgb_material(std::vector<Material>{{40, .9, g}, {70, .95, g}, {25, .5, g}});
    std::string script = to_blender(material, {.name = "jade", .mm_per_scene_unit = 10});
    const size_t at = script.find("AS_SUBSURFACE = False");
    ASSERT_NE(at, std::string::npos);
    const auto said = run_blender(script.replace(at, 21, "AS_SUBSURFACE = True"));
    const double read_g = parse_numbers(said.at("g")).at(0);
    EXPECT_NEAR(read_g, std::clamp(g, 0., .9), 1e-6);
    const Rgb color = parse_rgb(said.at("diffuse_albedo")), sigma_t = parse_rgb(said.at("sigma_t"));
    for (size_t c = 0; c < 3; ++c) {
      const double albedo = albedo_of(color[c], read_g);
      EXPECT_NEAR(sigma_t[c] * (1 - albedo), 10 * material.sigma_a[c], 1e-3 * material.sigma_a[c]);
      EXPECT_NEAR(sigma_t[c] * albedo * (1 - read_g), 10 * material.sigma_s_reduced(c),
                  1e-3 * material.sigma_s_reduced(c));
    }
  }
}

}  // namespace
}  // namespace itn
