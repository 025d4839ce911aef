#include "client/import/mitsuba_xml.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <memory>
#include <pugixml.hpp>
#include <set>
#include <sstream>

#include "client/image/spectrum.h"
#include "client/image/srgb.h"
#include "common/angle.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/printable.h"
#include "common/vec.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxDepth = 64;                   // of tags, files and references, in one another
constexpr size_t kMaxBytes = size_t{64} << 20;  // of all files together
constexpr size_t kMaxFiles = 1000;
constexpr size_t kMaxText = size_t{1} << 20;  // of an attribute, after its defaults

// "toWorld" as "to_world", "intIOR" as "int_ior".
std::string with_underscores(const std::string& name) {
  std::string result;
  bool after_lower = false;
  for (const char c : name) {
    const bool upper = std::isupper(static_cast<unsigned char>(c)) != 0;
    if (upper && after_lower) result += '_';
    result += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    after_lower = !upper;
  }
  return result;
}

// Numbers apart by commas or spaces.
std::vector<double> numbers_of(const std::string& text, const std::string& place) {
  std::string spaced = text;
  std::ranges::replace(spaced, ',', ' ');
  std::istringstream words(spaced);
  std::vector<double> numbers;
  for (std::string word; words >> word;) {
    double number = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
    if (error != std::errc() || end != word.data() + word.size() || !std::isfinite(number)) {
      throw invalid_input(fmt::format("{}: \"{}\" is not a number", place, printable(word)));
    }
    numbers.push_back(number);
  }
  return numbers;
}

// Pairs of a wavelength and a value, "400:0.1, 500:0.2".
std::map<double, double> spectrum_of(std::string text, const std::string& place) {
  std::ranges::replace(text, ':', ' ');
  const std::vector<double> numbers = numbers_of(text, place);
  std::map<double, double> spectrum;
  for (size_t i = 0; i + 1 < numbers.size(); i += 2) spectrum[numbers[i]] = numbers[i + 1];
  if (numbers.size() % 2 != 0 || spectrum.size() != numbers.size() / 2) {
    throw invalid_input(place + ": a spectrum is pairs of a wavelength and a value, each once");
  }
  return spectrum;
}

double number_of(const std::string& text, const std::string& place) {
  const std::vector<double> numbers = numbers_of(text, place);
  if (numbers.size() != 1)
    throw invalid_input(fmt::format("{}: \"{}\" is not a number", place, printable(text)));
  return numbers[0];
}

// A vector by one attribute, "1, 2, 3", or by x, y and z, each `otherwise` if it is absent.
Eigen::Vector3d vector_of(const std::map<std::string, std::string>& attributes,
                          const std::string& name, double otherwise, const std::string& place) {
  if (const auto whole = attributes.find(name); whole != attributes.end()) {
    const std::vector<double> numbers = numbers_of(whole->second, place);
    if (numbers.size() == 1) return Eigen::Vector3d::Constant(numbers[0]);
    if (numbers.size() != 3) {
      throw invalid_input(fmt::format("{}: {} is \"{}\"; it must be three numbers", place, name,
                                      printable(whole->second)));
    }
    return {numbers[0], numbers[1], numbers[2]};
  }
  Eigen::Vector3d result;
  for (int k = 0; k < 3; ++k) {
    const auto one = attributes.find(std::string(1, "xyz"[k]));
    result[k] = one == attributes.end() ? otherwise : number_of(one->second, place);
  }
  return result;
}

// Text from a file, as it may stand in a message or a comment.
std::string in_quotes(const std::string& text) {
  return '"' + printable(text) + '"';
}

// A file that is read, and where its lines begin.
struct Document {
  Document(const fs::path& file, std::string_view text) : path(file) {
    const pugi::xml_parse_result result = xml.load_buffer(text.data(), text.size());
    for (size_t at = 0; at < text.size(); ++at) {
      if (text[at] == '\n') line_ends.push_back(static_cast<ptrdiff_t>(at));
    }
    if (result.status == pugi::status_no_document_element) {
      throw invalid_input(fmt::format("{} is not in XML, as scenes of Mitsuba are",
                                      printable(path.string(), kMaxPath)));
    }
    if (!result)
      throw invalid_input(fmt::format("{}: {}", place(result.offset), result.description()));
  }

  // `scene.xml:12`
  std::string place(ptrdiff_t offset) const {
    const auto line = std::ranges::lower_bound(line_ends, offset) - line_ends.begin() + 1;
    return fmt::format("{}:{}", printable(path.string(), kMaxPath), line);
  }
  std::string place(const pugi::xml_node& node) const { return place(node.offset_debug()); }

  static constexpr size_t kMaxPath = 400;
  fs::path path;
  pugi::xml_document xml;
  std::vector<ptrdiff_t> line_ends;
};

class Reader {
 public:
  explicit Reader(const std::map<std::string, std::string>& definitions)
      : defaults_(definitions.begin(), definitions.end()) {}

  MitsubaFile read(const fs::path& path) {
    const std::set<std::string> defined = names_of(defaults_);
    const std::unique_ptr<Document> document = parse(path);
    const pugi::xml_node root = document->xml.child("scene");
    if (!root) throw invalid_input(fmt::format("{}: no <scene>", document->place(ptrdiff_t{0})));
    MitsubaFile file;
    file.is_3 = is_version_3(root, *document);
    file.has_version = *root.attribute("version").value() != 0;
    const auto scene = plugin(root, *document, 0);
    try {
      resolve_references();
      check_depth(*scene);
    } catch (const Error&) {
      forget_references();
      throw;
    }
    for (const std::string& name : defined) {
      if (used_.contains(name)) continue;
      throw invalid_input(fmt::format("{}: nothing has ${}; it cannot be defined",
                                      printable(path.string(), Document::kMaxPath),
                                      printable(name)));
    }
    file.scene = scene;
    return file;
  }

 private:
  using Defaults = std::map<std::string, std::string, std::greater<>>;  // longer names first

  static std::set<std::string> names_of(const Defaults& defaults) {
    std::set<std::string> names;
    for (const auto& [name, value] : defaults) names.insert(name);
    return names;
  }

  // Mitsuba 2 and 3 have the same scenes. A file without a version is read as theirs.
  static bool is_version_3(const pugi::xml_node& root, const Document& document) {
    constexpr int kNewest = 3;
    const std::string version = root.attribute("version").value();
    if (version.empty()) return true;
    int major = -1;
    const auto [end, error] =
        std::from_chars(version.data(), version.data() + version.size(), major);
    const bool ends_well = end == version.data() + version.size() || *end == '.';
    if (error != std::errc() || !ends_well || major < 0 || major > kNewest) {
      throw invalid_input(fmt::format("{}: version {} is unknown; 0.4 to {} are not",
                                      document.place(root), in_quotes(version), kNewest));
    }
    return major > 0;
  }

  std::unique_ptr<Document> parse(const fs::path& path) {
    const std::string text = read_file(path, "scene", kMaxBytes);
    bytes_ += text.size();
    if (++files_ > kMaxFiles || bytes_ > kMaxBytes) {
      throw invalid_input(fmt::format("{}: more than {} files, or {} bytes, are included",
                                      printable(path.string(), Document::kMaxPath), kMaxFiles,
                                      kMaxBytes));
    }
    return std::make_unique<Document>(path, text);
  }

  // With $names replaced by their values.
  std::string value_of(const pugi::xml_node& node, const pugi::xml_attribute& attribute,
                       const Document& document) {
    std::string text = attribute.value();
    const auto wrong = [&](const std::string& what) {
      return invalid_input(
          fmt::format("{}: <{}>: {}", document.place(node), printable(node.name()), what));
    };
    for (const auto& [name, value] : defaults_) {
      for (size_t at = 0; (at = text.find('$' + name, at)) != std::string::npos;) {
        text.replace(at, name.size() + 1, value);
        at += value.size();
        used_.insert(name);
        if (text.size() > kMaxText) {
          throw wrong(
              fmt::format("its {} has more than {} characters, with what its $names stand "
                          "for",
                          printable(attribute.name()), kMaxText));
        }
      }
    }
    if (const size_t at = text.find('$'); at != std::string::npos) {
      throw wrong(fmt::format("{}: {} has no <default>; -D {}=VALUE defines it", in_quotes(text),
                              printable(text.substr(at)), printable(text.substr(at + 1))));
    }
    return text;
  }
  std::string value_of(const pugi::xml_node& node, const char* name, const Document& document) {
    return value_of(node, node.attribute(name), document);
  }

  std::map<std::string, std::string> attributes_of(const pugi::xml_node& node,
                                                   const Document& document) {
    std::map<std::string, std::string> result;
    for (const pugi::xml_attribute& each : node.attributes()) {
      result[each.name()] = value_of(node, each, document);
    }
    return result;
  }

  std::shared_ptr<MitsubaPlugin> plugin(const pugi::xml_node& node, const Document& document,
                                        int depth) {
    auto result = std::make_shared<MitsubaPlugin>();
    result->tag = node.name();
    result->type = value_of(node, "type", document);
    result->id = value_of(node, "id", document);
    result->place = fmt::format("{}: <{}{}>", document.place(node), printable(result->tag),
                                result->type.empty() ? "" : " type=" + in_quotes(result->type));
    fill(*result, node, document, depth + 1);
    return result;
  }

  void fill(MitsubaPlugin& filled, const pugi::xml_node& node, const Document& document,
            int depth) {
    if (depth > kMaxDepth) {
      throw invalid_input(fmt::format("{}: more than {} tags or files in one another",
                                      document.place(node), kMaxDepth));
    }
    for (const pugi::xml_node& child : node.children()) {
      if (child.type() != pugi::node_element) continue;
      const std::string tag = child.name();
      const auto value = [&](const char* name) { return value_of(child, name, document); };
      if (tag == "default") {
        defaults_.emplace(child.attribute("name").value(), value("value"));
      } else if (tag == "include") {
        try {
          include(filled, document.path.parent_path() / value("filename"), depth);
        } catch (const Error& error) {
          if (error.kind() != ErrorKind::kIo) throw;
          throw Error(error.kind(),
                      fmt::format("{}: <include>: {}", document.place(child), error.what()));
        }
      } else if (tag == "ref") {
        references_.push_back(
            {&filled, filled.children.size(), value("id"), document.place(child)});
        filled.children.push_back({with_underscores(value("name")), nullptr});
      } else if (tag == "transform") {
        const std::string name = with_underscores(value("name"));
        if (!filled.transforms.emplace(name, transform_of(child, document)).second) {
          throw twice(child, name, document);
        }
      } else if (tag == "alias") {
        aliases_[value("as")] = value("id");
      } else if (is_property(tag)) {
        MitsubaProperty property{tag, attributes_of(child, document)};
        const std::string name = with_underscores(property.attributes["name"]);
        if (!filled.properties.emplace(name, std::move(property)).second) {
          throw twice(child, name, document);
        }
      } else {
        const MitsubaChild part{with_underscores(value("name")), plugin(child, document, depth)};
        const std::string& id = part.plugin->id;
        if (!id.empty() && !by_id_.emplace(id, part).second) {
          throw invalid_input(fmt::format("{}: the id {} is another one's already",
                                          part.plugin->place, in_quotes(id)));
        }
        filled.children.push_back(part);
      }
    }
  }

  static Error twice(const pugi::xml_node& node, const std::string& name,
                     const Document& document) {
    return invalid_input(fmt::format("{}: <{}>: {} is said twice", document.place(node),
                                     printable(node.name()), in_quotes(name)));
  }

  void include(MitsubaPlugin& plugin, const fs::path& path, int depth) {
    const std::unique_ptr<Document> document = parse(path);
    const pugi::xml_node root = document->xml.first_child();
    if (std::string(root.name()) == "scene") {
      fill(plugin, root, *document, depth + 1);
    } else {
      fill(plugin, document->xml, *document, depth + 1);
    }
  }

  // What is referred to may be defined later.
  void resolve_references() {
    for (const auto& [in, number, id, place] : references_) {
      std::string real = id;
      for (int hops = 0; aliases_.contains(real) && hops < kMaxDepth; ++hops) real = aliases_[real];
      const auto found = by_id_.find(real);
      if (found == by_id_.end()) {
        throw invalid_input(
            fmt::format("{}: <ref id={}/>: nothing has this id", place, in_quotes(id)));
      }
      MitsubaChild& child = in->children[number];
      if (child.name.empty()) child.name = found->second.name;
      child.plugin = found->second.plugin;
    }
  }

  // What refers to itself would hold itself for ever.
  void forget_references() {
    for (const Reference& reference : references_) {
      reference.in->children[reference.number].plugin.reset();
    }
  }

  // Depth of what a plugin refers to: each is visited once, so that few bytes take little time.
  int check_depth(const MitsubaPlugin& plugin) {
    const auto [known, is_new] = depths_.emplace(&plugin, kInWork);
    if (!is_new && known->second != kInWork) return known->second;
    if (!is_new) throw invalid_input(plugin.place + ": refers to itself");
    int deepest = 0;
    for (const MitsubaChild& child : plugin.children) {
      deepest = std::max(deepest, 1 + check_depth(*child.plugin));
    }
    if (deepest > kMaxDepth) {
      throw invalid_input(
          fmt::format("{}: more than {} references in one another", plugin.place, kMaxDepth));
    }
    return depths_[&plugin] = deepest;
  }

  static bool is_property(const std::string& tag) {
    constexpr std::array kTags{"integer", "float", "boolean",  "string",    "point", "vector",
                               "rgb",     "srgb",  "spectrum", "blackbody", "xyz"};
    return std::ranges::find(kTags, tag) != kTags.end();
  }

  // Its steps are done in the order that they are written in.
  Eigen::Affine3d transform_of(const pugi::xml_node& node, const Document& document) {
    Eigen::Affine3d result = Eigen::Affine3d::Identity();
    for (const pugi::xml_node& step : node.children()) {
      if (step.type() != pugi::node_element) continue;
      result = step_of(step, document) * result;
    }
    return result;
  }

  // What Mitsuba 3 takes for `up` where a file has none: a vector at right angles to the unit one.
  static Eigen::Vector3d tangent_of(const Eigen::Vector3d& ahead) {
    const Vec3d s = Basis<double>(Vec3d{ahead.x(), ahead.y(), ahead.z()}).s;
    return {s.x, s.y, s.z};
  }

  Eigen::Affine3d step_of(const pugi::xml_node& step, const Document& document) {
    const std::string tag = with_underscores(step.name());
    const std::string place = document.place(step) + ": <transform>";
    const auto attributes = attributes_of(step, document);
    const auto value = [&](const char* name) { return value_of(step, name, document); };
    const auto vector = [&](const std::string& name, double otherwise) {
      return vector_of(attributes, name, otherwise, place);
    };
    Eigen::Affine3d result = Eigen::Affine3d::Identity();
    if (tag == "translate") {
      result.translate(vector("value", 0));
    } else if (tag == "scale") {
      result.scale(vector("value", 1));
    } else if (tag == "rotate") {
      const Eigen::Vector3d axis = vector("value", 0);
      if (axis.norm() == 0) throw invalid_input(place + ": a rotation about an axis of length 0");
      const double angle = number_of(value("angle"), place);
      result.rotate(Eigen::AngleAxisd(angle * kRadiansPerDegree, axis.normalized()));
    } else if (tag == "matrix") {
      const std::vector<double> m = numbers_of(value("value"), place);
      const auto side = static_cast<Eigen::Index>(m.size() == 9 ? 3 : 4);
      if (m.size() != 9 && m.size() != 16) {
        throw invalid_input(
            fmt::format("{}: a matrix of {} numbers; 16 or 9 would be right", place, m.size()));
      }
      for (Eigen::Index i = 0; i < side; ++i) {
        for (Eigen::Index j = 0; j < side; ++j) {
          result.matrix()(i, j) = m[static_cast<size_t>(i * side + j)];
        }
      }
      if (result.matrix().row(3) != Eigen::RowVector4d(0, 0, 0, 1)) {
        throw invalid_input(place + ": a matrix whose last row is not 0 0 0 1");
      }
    } else if (tag == "lookat" || tag == "look_at") {
      const Eigen::Vector3d origin = vector("origin", 0), target = vector("target", 0);
      const Eigen::Vector3d ahead = (target - origin).normalized();
      const Eigen::Vector3d up = attributes.contains("up") ? vector("up", 0) : tangent_of(ahead);
      const Eigen::Vector3d left = up.cross(ahead).normalized();
      if (!ahead.allFinite() || !left.allFinite() || left.norm() == 0) {
        throw invalid_input(place + ": a lookat whose target is its origin, or lies along `up`");
      }
      result.linear() << left, ahead.cross(left), ahead;
      result.translation() = origin;
    } else {
      throw invalid_input(
          fmt::format("{}: <{}> is unknown; translate, rotate, scale, matrix and lookat are not",
                      place, printable(step.name())));
    }
    return result;
  }

  struct Reference {
    MitsubaPlugin* in;
    size_t number;  // of the child that it is
    std::string id, place;
  };
  static constexpr int kInWork = -1;

  Defaults defaults_;
  std::set<std::string> used_;  // of their names
  std::map<std::string, MitsubaChild> by_id_;
  std::map<std::string, std::string> aliases_;
  std::vector<Reference> references_;
  std::map<const MitsubaPlugin*, int> depths_;
  size_t files_ = 0, bytes_ = 0;
};

const MitsubaProperty* find(const MitsubaPlugin& plugin, const std::string& name) {
  const auto found = plugin.properties.find(name);
  if (found == plugin.properties.end()) return nullptr;
  found->second.used = true;
  return &found->second;
}

std::string attribute(const MitsubaProperty& property, const std::string& name) {
  const auto found = property.attributes.find(name);
  return found == property.attributes.end() ? "" : found->second;
}

}  // namespace

double MitsubaPlugin::number(const std::string& property, double otherwise) const {
  const MitsubaProperty* const found = find(*this, property);
  return found ? number_of(attribute(*found, "value"), place + " " + property) : otherwise;
}

std::string MitsubaPlugin::text(const std::string& property, const std::string& otherwise) const {
  const MitsubaProperty* const found = find(*this, property);
  return found ? attribute(*found, "value") : otherwise;
}

bool MitsubaPlugin::flag(const std::string& property, bool otherwise) const {
  if (!has(property)) return otherwise;
  const std::string value = text(property, "");
  std::string lower = value;
  std::ranges::transform(lower, lower.begin(), [](unsigned char c) { return std::tolower(c); });
  if (lower == "true" || lower == "false") return lower == "true";
  throw invalid_input(fmt::format("{} {}: {} is neither true nor false", place, printable(property),
                                  in_quotes(value)));
}

bool MitsubaPlugin::has_spectrum(const std::string& property) const {
  const auto found = properties.find(property);
  return found != properties.end() &&
         attribute(found->second, "value").find(':') != std::string::npos;
}

std::array<double, 3> MitsubaPlugin::colour(const std::string& property, double otherwise) const {
  const MitsubaProperty* const found = find(*this, property);
  if (!found) {
    // Mitsuba 3 writes constants as plugins, too.
    const MitsubaPlugin* const constant = child("volume", property);
    if (constant && constant->type != "constvolume") {
      throw invalid_input(
          fmt::format("{}: {} varies from place to place; a medium here is the same "
                      "everywhere",
                      constant->place, printable(property)));
    }
    return constant ? constant->colour("value", otherwise)
                    : std::array{otherwise, otherwise, otherwise};
  }
  const std::string where = place + " " + property, text = attribute(*found, "value");
  if (text.starts_with('#')) {
    unsigned hex = 0;
    const auto [end, error] = std::from_chars(text.data() + 1, text.data() + text.size(), hex, 16);
    if (error != std::errc() || end != text.data() + text.size() || text.size() != 7) {
      throw invalid_input(fmt::format("{}: {} is no colour as #rrggbb", where, in_quotes(text)));
    }
    const auto part = [&](unsigned shift) { return linear_of_srgb((hex >> shift & 0xFF) / 255.0); };
    return {part(16), part(8), part(0)};
  }
  if (has_spectrum(property)) return colour_of_spectrum(spectrum_of(text, where));
  if (text.empty()) {
    const std::string kind = attribute(*found, "type");
    throw invalid_input(
        fmt::format("{}: <{}{}> is not understood; one number, three of R, G and B, "
                    "or #rrggbb are",
                    where, printable(found->tag), kind.empty() ? "" : " type=" + in_quotes(kind)));
  }
  std::vector<double> numbers = numbers_of(text, where);
  if (numbers.size() == 1) numbers.assign(3, numbers[0]);
  if (numbers.size() != 3) {
    throw invalid_input(
        fmt::format("{}: {} numbers; 1 or 3 would be right", where, numbers.size()));
  }
  if (found->tag == "srgb") std::ranges::transform(numbers, numbers.begin(), linear_of_srgb);
  return {numbers[0], numbers[1], numbers[2]};
}

Eigen::Vector3d MitsubaPlugin::vector(const std::string& property,
                                      const Eigen::Vector3d& otherwise) const {
  const MitsubaProperty* const found = find(*this, property);
  return found ? vector_of(found->attributes, "value", 0, place + " " + property) : otherwise;
}

Eigen::Affine3d MitsubaPlugin::transform(const std::string& transform_name) const {
  used_transforms.insert(transform_name);
  const auto found = transforms.find(transform_name);
  return found == transforms.end() ? Eigen::Affine3d::Identity() : found->second;
}

const MitsubaPlugin* MitsubaPlugin::child(const std::string& child_tag,
                                          const std::string& child_name) const {
  for (const auto& [called, plugin] : children) {
    if (plugin->tag == child_tag && (child_name.empty() || called == child_name)) {
      plugin->used = true;
      return plugin.get();
    }
  }
  return nullptr;
}

MitsubaFile read_mitsuba(const fs::path& path,
                         const std::map<std::string, std::string>& definitions) {
  return Reader(definitions).read(path);
}

}  // namespace itn
