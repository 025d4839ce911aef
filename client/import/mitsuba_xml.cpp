#include "client/import/mitsuba_xml.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <pugixml.hpp>
#include <sstream>

#include "common/angle.h"
#include "common/error.h"
#include "common/files/read_file.h"
#include "common/image/srgb.h"

namespace itn {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxDepth = 64;  // of tags, and files that include others, in one another
constexpr size_t kMaxBytes = size_t{64} << 20;

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
      throw invalid_input(fmt::format("{}: \"{}\" is not a number", place, word));
    }
    numbers.push_back(number);
  }
  return numbers;
}

double number_of(const std::string& text, const std::string& place) {
  const std::vector<double> numbers = numbers_of(text, place);
  if (numbers.size() != 1)
    throw invalid_input(fmt::format("{}: \"{}\" is not a number", place, text));
  return numbers[0];
}

// Of one attribute, "1, 2, 3", or of x, y and z, each `otherwise` if it is absent.
Eigen::Vector3d vector_of(const std::map<std::string, std::string>& attributes,
                          const std::string& name, double otherwise, const std::string& place) {
  if (const auto whole = attributes.find(name); whole != attributes.end()) {
    const std::vector<double> numbers = numbers_of(whole->second, place);
    if (numbers.size() == 1) return Eigen::Vector3d::Constant(numbers[0]);
    if (numbers.size() != 3) {
      throw invalid_input(
          fmt::format("{}: {} is \"{}\"; it must be three numbers", place, name, whole->second));
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

class Reader {
 public:
  MitsubaFile read(const fs::path& path) {
    const pugi::xml_document document = parse(path);
    const pugi::xml_node root = document.child("scene");
    if (!root) throw invalid_input(fmt::format("{}: no <scene>", path.string()));
    MitsubaFile file;
    file.is_3 = !std::string(root.attribute("version").value()).starts_with("0.");
    file.scene = plugin(root, path, 0);
    return file;
  }

 private:
  static pugi::xml_document parse(const fs::path& path) {
    const std::string text = read_file(path, "scene", kMaxBytes);
    pugi::xml_document document;
    const pugi::xml_parse_result result = document.load_buffer(text.data(), text.size());
    if (!result) {
      const auto line = std::count(text.begin(), text.begin() + result.offset, '\n') + 1;
      throw invalid_input(fmt::format("{}:{}: {}", path.string(), line, result.description()));
    }
    return document;
  }

  // With $names replaced by their values.
  std::string value_of(const pugi::xml_attribute& attribute) const {
    std::string text = attribute.value();
    for (const auto& [name, value] : defaults_) {
      for (size_t at = 0; (at = text.find('$' + name, at)) != std::string::npos;) {
        text.replace(at, name.size() + 1, value);
        at += value.size();
      }
    }
    if (const size_t at = text.find('$'); at != std::string::npos) {
      throw invalid_input(fmt::format("\"{}\": {} has no <default>", text, text.substr(at)));
    }
    return text;
  }

  std::map<std::string, std::string> attributes_of(const pugi::xml_node& node) const {
    std::map<std::string, std::string> result;
    for (const pugi::xml_attribute& each : node.attributes()) result[each.name()] = value_of(each);
    return result;
  }

  std::shared_ptr<MitsubaPlugin> plugin(const pugi::xml_node& node, const fs::path& path,
                                        int depth) {
    const auto result = std::make_shared<MitsubaPlugin>();
    result->tag = node.name();
    result->type = value_of(node.attribute("type"));
    result->id = value_of(node.attribute("id"));
    result->name = with_underscores(value_of(node.attribute("name")));
    result->place = fmt::format("{}: <{}{}>", path.string(), result->tag,
                                result->type.empty() ? "" : " type=\"" + result->type + '"');
    fill(*result, node, path, depth + 1);
    if (!result->id.empty()) by_id_[result->id] = result;
    return result;
  }

  void fill(MitsubaPlugin& to, const pugi::xml_node& node, const fs::path& path, int depth) {
    if (depth > kMaxDepth) {
      throw invalid_input(
          fmt::format("{}: more than {} tags or files in one another", path.string(), kMaxDepth));
    }
    for (const pugi::xml_node& child : node.children()) {
      if (child.type() != pugi::node_element) continue;
      const std::string tag = child.name();
      if (tag == "default") {
        defaults_.emplace(child.attribute("name").value(), value_of(child.attribute("value")));
      } else if (tag == "include") {
        include(to, path.parent_path() / value_of(child.attribute("filename")), depth);
      } else if (tag == "ref") {
        refer(to, value_of(child.attribute("id")), value_of(child.attribute("name")));
      } else if (tag == "transform") {
        to.transforms[with_underscores(value_of(child.attribute("name")))] =
            transform_of(child, to.place);
      } else if (tag == "alias") {
        const auto found = by_id_.find(value_of(child.attribute("id")));
        if (found != by_id_.end()) by_id_[value_of(child.attribute("as"))] = found->second;
      } else if (is_property(tag)) {
        MitsubaProperty property{tag, attributes_of(child)};
        const std::string name = with_underscores(property.attributes["name"]);
        to.properties[name] = std::move(property);
      } else {
        to.children.push_back(plugin(child, path, depth));
      }
    }
  }

  void include(MitsubaPlugin& to, const fs::path& path, int depth) {
    const pugi::xml_document document = parse(path);
    const pugi::xml_node root = document.first_child();
    if (std::string(root.name()) == "scene") {
      fill(to, root, path, depth + 1);
    } else {
      fill(to, document, path, depth + 1);
    }
  }

  void refer(MitsubaPlugin& to, const std::string& id, const std::string& name) const {
    const auto found = by_id_.find(id);
    if (found == by_id_.end()) {
      throw invalid_input(
          fmt::format("{}: <ref id=\"{}\"/>: nothing before has this id", to.place, id));
    }
    if (name.empty() || name == found->second->name) {
      to.children.push_back(found->second);
      return;
    }
    // Under another name: a copy, whose parts are shared.
    const auto named = std::make_shared<MitsubaPlugin>(*found->second);
    named->name = with_underscores(name);
    to.children.push_back(named);
  }

  static bool is_property(const std::string& tag) {
    constexpr std::array kTags{"integer", "float", "boolean",  "string",    "point", "vector",
                               "rgb",     "srgb",  "spectrum", "blackbody", "xyz"};
    return std::ranges::find(kTags, tag) != kTags.end();
  }

  // Its steps are done in the order that they are written in.
  Eigen::Affine3d transform_of(const pugi::xml_node& node, const std::string& of) const {
    const std::string place = of + ": <transform>";
    Eigen::Affine3d result = Eigen::Affine3d::Identity();
    for (const pugi::xml_node& step : node.children()) {
      if (step.type() != pugi::node_element) continue;
      result = step_of(step, place) * result;
    }
    return result;
  }

  Eigen::Affine3d step_of(const pugi::xml_node& step, const std::string& place) const {
    const std::string tag = with_underscores(step.name());
    const auto attributes = attributes_of(step);
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
      const double angle = number_of(value_of(step.attribute("angle")), place);
      result.rotate(Eigen::AngleAxisd(angle * kRadiansPerDegree, axis.normalized()));
    } else if (tag == "matrix") {
      const std::vector<double> m = numbers_of(value_of(step.attribute("value")), place);
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
      const Eigen::Vector3d up =
          attributes.contains("up") ? vector("up", 0) : Eigen::Vector3d(0, 1, 0);
      const Eigen::Vector3d ahead = (target - origin).normalized();
      const Eigen::Vector3d left = up.cross(ahead).normalized();
      if (!ahead.allFinite() || !left.allFinite() || left.norm() == 0) {
        throw invalid_input(place + ": a lookat whose target is its origin, or lies along `up`");
      }
      result.linear() << left, ahead.cross(left), ahead;
      result.translation() = origin;
    } else {
      throw invalid_input(
          fmt::format("{}: <{}> is unknown; translate, rotate, scale, matrix and lookat are not",
                      place, step.name()));
    }
    return result;
  }

  std::map<std::string, std::string, std::greater<>> defaults_;  // longer names first
  std::map<std::string, std::shared_ptr<const MitsubaPlugin>> by_id_;
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

std::array<double, 3> MitsubaPlugin::colour(const std::string& property, double otherwise) const {
  const MitsubaProperty* const found = find(*this, property);
  if (!found) {
    // Mitsuba 3 writes constants as plugins, too.
    const MitsubaPlugin* const constant = child("volume", property);
    return constant ? constant->colour("value", otherwise)
                    : std::array{otherwise, otherwise, otherwise};
  }
  const std::string where = place + " " + property, text = attribute(*found, "value");
  if (text.starts_with('#')) {
    unsigned hex = 0;
    const auto [end, error] = std::from_chars(text.data() + 1, text.data() + text.size(), hex, 16);
    if (error != std::errc() || end != text.data() + text.size() || text.size() != 7) {
      throw invalid_input(fmt::format("{}: \"{}\" is no colour as #rrggbb", where, text));
    }
    const auto part = [&](unsigned shift) { return linear_of_srgb((hex >> shift & 0xFF) / 255.0); };
    return {part(16), part(8), part(0)};
  }
  if (text.empty() || text.find(':') != std::string::npos) {
    throw invalid_input(
        fmt::format("{}: \"{}\" is not understood; one number, three of R, G and B, or #rrggbb are",
                    where, text));
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
  const auto found = transforms.find(transform_name);
  return found == transforms.end() ? Eigen::Affine3d::Identity() : found->second;
}

const MitsubaPlugin* MitsubaPlugin::child(const std::string& child_tag,
                                          const std::string& child_name) const {
  for (const auto& each : children) {
    if (each->tag == child_tag && (child_name.empty() || each->name == child_name)) {
      each->used = true;
      return each.get();
    }
  }
  return nullptr;
}

MitsubaFile read_mitsuba(const fs::path& path) {
  return Reader().read(path);
}

}  // namespace itn
