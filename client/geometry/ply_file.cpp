// PLY, text and binary: http://paulbourke.net/dataformats/ply/. Elements other than vertices and
// faces are passed over.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <sstream>
#include <type_traits>

#include "client/geometry/mesh_formats.h"
#include "common/printable.h"

namespace itn {
namespace {

template <typename T>
double decoded(const char* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof value);
  return static_cast<double>(value);
}

struct Type {
  std::string_view name, other_name;
  size_t size;
  bool is_integer;
  double (*decode)(const char* bytes);  // little endian
};
static_assert(std::endian::native == std::endian::little);
template <typename T>
constexpr Type type_of(std::string_view name, std::string_view other_name) {
  return {name, other_name, sizeof(T), std::is_integral_v<T>, decoded<T>};
}
constexpr std::array kTypes{
    type_of<int8_t>("char", "int8"),    type_of<uint8_t>("uchar", "uint8"),
    type_of<int16_t>("short", "int16"), type_of<uint16_t>("ushort", "uint16"),
    type_of<int32_t>("int", "int32"),   type_of<uint32_t>("uint", "uint32"),
    type_of<float>("float", "float32"), type_of<double>("double", "float64"),
};

struct Property {
  std::string name;
  const Type* type;
  const Type* count_type = nullptr;  // of a list
};

struct Element {
  std::string name;
  uint64_t count = 0;
  std::vector<Property> properties;
};

enum class Format { kText, kLittleEndian, kBigEndian };
constexpr std::string_view kFormatNames[] = {"ascii", "binary_little_endian", "binary_big_endian"};

class PlyReader {
 public:
  PlyReader(std::string_view content, const std::string& what) : rest_(content), what_(what) {}

  Mesh run() {
    read_header();
    for (const Element& element : elements_) read(element);
    const auto is_strips = [](const Element& element) {
      return element.name == "tristrips" && element.count > 0;
    };
    if (mesh_.sizes.empty() && std::ranges::any_of(elements_, is_strips)) {
      throw wrong(
          "it has its triangles as strips (element tristrips), which are not read; save it "
          "with faces");
    }
    return triangulated(mesh_, what_);
  }

 private:
  Error wrong(const std::string& reason) const {
    return invalid_input(fmt::format("{}: {}", what_, reason));
  }

  // --- The header ---

  const Type* type(const std::string& name) const {
    const auto* const found = std::ranges::find_if(
        kTypes, [&](const Type& t) { return t.name == name || t.other_name == name; });
    if (found == kTypes.end()) {
      throw wrong(fmt::format("its header has the unknown type \"{}\"", name));
    }
    return found;
  }

  void read_header() {
    constexpr size_t kMaxLine = 4096;
    constexpr int kMaxLines = 10'000;
    if (rest_.empty()) throw cut_short(what_, "it is empty");
    if (!rest_.starts_with("ply")) {
      throw wrong("it is not a PLY file: it does not begin with \"ply\"");
    }
    for (int i = 0; i < kMaxLines && rest_.find('\n') != std::string_view::npos; ++i) {
      const std::string_view line = take_line(rest_);
      if (line.size() > kMaxLine) throw wrong("its header has a line of more than 4096 bytes");
      std::istringstream words{std::string(line)};
      std::string keyword;
      words >> keyword;
      if (keyword == "end_header") return;
      if (keyword == "format") {
        read_format(words);
      } else if (keyword == "element") {
        Element& element = elements_.emplace_back();
        if (!(words >> element.name >> element.count)) {
          throw wrong("its header has an element without name and count");
        }
      } else if (keyword == "property") {
        read_property(words);
      }
    }
    throw cut_short(what_, "its header has no end_header");
  }

  void read_format(std::istream& words) {
    std::string name;
    words >> name;
    const auto* const found = std::ranges::find(kFormatNames, name);
    if (found == std::end(kFormatNames)) {
      throw wrong(fmt::format("its header has the unknown format \"{}\"", name));
    }
    format_ = static_cast<Format>(found - kFormatNames);
  }

  void read_property(std::istream& words) {
    if (elements_.empty()) throw wrong("its header has a property before any element");
    Property property;
    std::string first;
    words >> first;
    if (first == "list") {
      std::string count, item;
      words >> count >> item;
      property.count_type = type(count);
      property.type = type(item);
      if (!property.count_type->is_integer) {
        throw wrong("its header has a list whose count is not an integer");
      }
    } else {
      property.type = type(first);
    }
    if (!(words >> property.name)) throw wrong("its header has a property without a name");
    elements_.back().properties.push_back(property);
  }

  // --- What it promises ---

  void read(const Element& element) {
    check_room(element);
    const bool is_vertex = element.name == "vertex", is_face = element.name == "face";
    if (is_vertex) mesh_.vertices.reserve(element.count);
    for (uint64_t i = 0; i < element.count; ++i) {
      const float missing = std::numeric_limits<float>::quiet_NaN();
      Vec3f position{missing, missing, missing};
      for (const Property& property : element.properties) {
        const std::string& name = property.name;
        if (is_face && (name == "vertex_indices" || name == "vertex_index")) {
          read_corners(property, element, i);
          continue;
        }
        float* const axis = !is_vertex    ? nullptr
                            : name == "x" ? &position.x
                            : name == "y" ? &position.y
                            : name == "z" ? &position.z
                                          : nullptr;
        const uint64_t items = list_size(property, element, i);
        for (uint64_t k = 0; k < items; ++k) {
          const double value = number(*property.type, element, i);
          if (axis != nullptr) *axis = static_cast<float>(value);
        }
      }
      if (is_vertex) mesh_.vertices.push_back(position);
    }
  }

  void read_corners(const Property& property, const Element& element, uint64_t i) {
    const uint64_t items = list_size(property, element, i);
    if (items > kMaxCorners) {
      throw wrong(fmt::format("face {} has a list of {} items; a face has at most {} corners", i,
                              items, kMaxCorners));
    }
    for (uint64_t k = 0; k < items; ++k) {
      const double vertex = number(*property.type, element, i);
      if (!(vertex >= 0 && vertex <= std::numeric_limits<uint32_t>::max())) {
        throw wrong(fmt::format("face {} refers to vertex {}", i, vertex));
      }
      mesh_.corners.push_back(static_cast<uint32_t>(vertex));
    }
    mesh_.sizes.push_back(static_cast<uint32_t>(items));
  }

  // The fewest bytes that hold a number: of a text a digit and a space.
  size_t least_size(const Type& type) const { return format_ == Format::kText ? 2 : type.size; }

  // Whether what follows may hold all of an element.
  void check_room(const Element& element) const {
    if (element.count == 0) return;
    if (element.properties.empty()) {
      throw wrong(fmt::format("its element \"{}\" has no properties", element.name));
    }
    size_t least = 0;
    for (const Property& property : element.properties) {
      least += least_size(property.count_type != nullptr ? *property.count_type : *property.type);
    }
    if (element.count > (rest_.size() + 1) / least) {
      throw cut_short(what_,
                      fmt::format("its header promises {} of element \"{}\"; {} bytes follow",
                                  element.count, element.name, rest_.size()));
    }
  }

  Error missing(const Element& element, uint64_t i) const {
    return cut_short(what_, fmt::format("it ends in number {} of {} of element \"{}\"", i,
                                        element.count, element.name));
  }

  // 1 if the property is no list.
  uint64_t list_size(const Property& property, const Element& element, uint64_t i) {
    if (property.count_type == nullptr) return 1;
    const double count = number(*property.count_type, element, i);
    if (!(count >= 0 && count == std::floor(count))) {
      throw wrong(fmt::format("number {} of element \"{}\" has a list of {} items", i, element.name,
                              count));
    }
    if (count > static_cast<double>((rest_.size() + 1) / least_size(*property.type))) {
      throw missing(element, i);
    }
    return static_cast<uint64_t>(count);
  }

  double number(const Type& type, const Element& element, uint64_t i) {
    if (format_ == Format::kText) {
      const std::string_view word = take_word(rest_);
      if (word.empty()) throw missing(element, i);
      const std::optional<double> value = number_in(word);
      if (!value) {
        throw wrong(fmt::format("number {} of element \"{}\" has \"{}\" where a number should be",
                                i, element.name, printable(word)));
      }
      return *value;
    }
    if (type.size > rest_.size()) throw missing(element, i);
    std::array<char, 8> bytes{};
    std::memcpy(bytes.data(), rest_.data(), type.size);
    if (format_ == Format::kBigEndian) std::reverse(bytes.begin(), bytes.begin() + type.size);
    rest_.remove_prefix(type.size);
    return type.decode(bytes.data());
  }

  std::string_view rest_;
  const std::string& what_;
  Format format_ = Format::kText;
  std::vector<Element> elements_;
  PolygonMesh mesh_;
};

}  // namespace

Mesh read_ply(std::string_view content, const std::string& what) {
  return PlyReader(content, what).run();
}

}  // namespace itn
