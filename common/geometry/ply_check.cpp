#include "common/geometry/ply_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <optional>
#include <sstream>
#include <string_view>
#include <vector>

#include "common/error.h"
#include "common/geometry/plain_number.h"

namespace itn {
namespace {

struct Type {
  std::string_view name, other_name;
  size_t size;
  bool is_integer;
};
constexpr std::array kTypes{
    Type{"char", "int8", 1, true},      Type{"uchar", "uint8", 1, true},
    Type{"short", "int16", 2, true},    Type{"ushort", "uint16", 2, true},
    Type{"int", "int32", 4, true},      Type{"uint", "uint32", 4, true},
    Type{"float", "float32", 4, false}, Type{"double", "float64", 8, false},
};

struct Property {
  const Type* type;
  const Type* count_type = nullptr;  // of a list
};

struct Element {
  std::string name;
  uint64_t count = 0;
  std::vector<Property> properties;
};

enum class Format { kText, kLittleEndian, kBigEndian };

class PlyCheck {
 public:
  PlyCheck(const std::string& content, const std::string& what) : content_(content), what_(what) {}

  std::string run() {
    read_header();
    std::string result = content_.substr(0, at_);
    if (format_ == Format::kText) {
      result.reserve(content_.size());
      for (const Element& element : elements_) copy_text(element, result);
    } else {
      const size_t begin = at_;
      for (const Element& element : elements_) skip_binary(element);
      // Assimp takes a first byte of binary data that looks like a line feed for a remainder of the
      // header, and drops it: it is given one to drop.
      if (begin < at_ && content_[begin] == '\n') result += '\n';
      result.append(content_, begin, at_ - begin);
    }
    return result;
  }

 private:
  Error wrong(const std::string& reason) const {
    return invalid_input(fmt::format("{}: {}", what_, reason));
  }
  Error cut_short(const std::string& reason) const {
    return Error(ErrorKind::kDataLoss, fmt::format("{} was cut short: {}", what_, reason));
  }

  // Without its end; nothing at the end of the file.
  std::optional<std::string> header_line() {
    const size_t end = content_.find('\n', at_);
    if (end == std::string::npos) return {};
    std::string line = content_.substr(at_, end - at_);
    if (line.ends_with('\r')) line.pop_back();
    at_ = end + 1;
    return line;
  }

  const Type* type(const std::string& name) const {
    const auto* const found = std::ranges::find_if(
        kTypes, [&](const Type& t) { return t.name == name || t.other_name == name; });
    if (found == kTypes.end())
      throw wrong(fmt::format("its header has the unknown type \"{}\"", name));
    return found;
  }

  void read_header() {
    constexpr size_t kMaxLine = 4096;
    constexpr int kMaxLines = 10'000;
    if (content_.empty()) throw cut_short("it is empty");
    if (!content_.starts_with("ply")) {
      throw wrong("it is not a PLY file: it does not begin with \"ply\"");
    }
    header_line();
    for (int i = 0; i < kMaxLines; ++i) {
      const std::optional<std::string> line = header_line();
      if (!line) break;
      if (line->size() > kMaxLine) throw wrong("its header has a line of more than 4096 bytes");
      std::istringstream words(*line);
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
    throw cut_short("its header has no end_header");
  }

  void read_format(std::istream& words) {
    std::string name;
    words >> name;
    if (name == "ascii") {
      format_ = Format::kText;
    } else if (name == "binary_little_endian") {
      format_ = Format::kLittleEndian;
    } else if (name == "binary_big_endian") {
      format_ = Format::kBigEndian;
    } else {
      throw wrong(fmt::format("its header has the unknown format \"{}\"", name));
    }
  }

  void read_property(std::istream& words) {
    if (elements_.empty()) throw wrong("its header has a property before any element");
    std::string first, name;
    words >> first;
    Property property{};
    if (first == "list") {
      std::string count, item;
      words >> count >> item;
      property = {type(item), type(count)};
      if (!property.count_type->is_integer)
        throw wrong("its header has a list whose count is not an integer");
    } else {
      property = {type(first)};
    }
    if (!(words >> name)) throw wrong("its header has a property without a name");
    elements_.back().properties.push_back(property);
  }

  // Whether what follows may hold all of an element, each property in so many bytes at least.
  void check_room(const Element& element, size_t least) const {
    if (element.count == 0) return;
    if (element.properties.empty()) {
      throw wrong(fmt::format("its element \"{}\" has no properties", element.name));
    }
    const uint64_t room = (content_.size() - at_ + 1) / std::max<size_t>(1, least);
    if (element.count > room) {
      throw cut_short(fmt::format("its header promises {} of element \"{}\"; {} bytes follow",
                                  element.count, element.name, content_.size() - at_));
    }
  }

  Error missing(const Element& element, uint64_t i) const {
    return cut_short(fmt::format("it ends in number {} of {} of element \"{}\"", i, element.count,
                                 element.name));
  }

  // Of the lists of a face one has its corners.
  void check_corners(const Element& element, uint64_t i, uint64_t items) const {
    if (element.name == "face" && items > kMaxCorners) {
      throw wrong(fmt::format("face {} has a list of {} items; a face has at most {} corners", i,
                              items, kMaxCorners));
    }
  }

  void copy_text(const Element& element, std::string& result) {
    check_room(element, 2 * element.properties.size());
    for (uint64_t i = 0; i < element.count; ++i) {
      for (const Property& property : element.properties) {
        uint64_t items = 1;
        if (property.count_type != nullptr) {
          const std::string_view count = number(element, i);
          const auto [end, error] =
              std::from_chars(count.data(), count.data() + count.size(), items);
          if (error != std::errc() || end != count.data() + count.size()) {
            throw wrong(fmt::format("number {} of element \"{}\" has a list of \"{}\" items", i,
                                    element.name, count));
          }
          result.append(count).push_back(' ');
        }
        for (uint64_t k = 0; k < items; ++k) {
          result.append(number(element, i)).push_back(' ');
        }
        check_corners(element, i, items);
      }
      result.back() = '\n';
    }
  }

  // The next word, which is a number.
  std::string_view number(const Element& element, uint64_t i) {
    const auto is_space = [](char c) { return c == ' ' || (c >= '\t' && c <= '\r'); };
    while (at_ < content_.size() && is_space(content_[at_])) ++at_;
    const size_t begin = at_;
    while (at_ < content_.size() && !is_space(content_[at_])) ++at_;
    const std::string_view word(content_.data() + begin, at_ - begin);
    if (word.empty()) throw missing(element, i);
    const std::optional<std::string_view> number = plain_number(word);
    if (!number) {
      throw wrong(fmt::format("number {} of element \"{}\" has \"{}\" where a number should be", i,
                              element.name, word.substr(0, kMaxNumber)));
    }
    return *number;
  }

  void skip_binary(const Element& element) {
    size_t least = 0;
    bool has_lists = false;
    for (const Property& property : element.properties) {
      least += property.count_type != nullptr ? property.count_type->size : property.type->size;
      has_lists = has_lists || property.count_type != nullptr;
    }
    check_room(element, least);
    if (!has_lists) {
      if (element.count * least > content_.size() - at_) throw missing(element, element.count - 1);
      at_ += element.count * least;
      return;
    }
    for (uint64_t i = 0; i < element.count; ++i) {
      for (const Property& property : element.properties) {
        uint64_t items = 1;
        if (property.count_type != nullptr) {
          items = binary_count(property.count_type->size, element, i);
        }
        if (items > (content_.size() - at_) / property.type->size) throw missing(element, i);
        check_corners(element, i, items);
        at_ += items * property.type->size;
      }
    }
  }

  // A negative one is read as a large one, which no file can hold.
  uint64_t binary_count(size_t size, const Element& element, uint64_t i) {
    if (size > content_.size() - at_) throw missing(element, i);
    uint64_t value = 0;
    for (size_t k = 0; k < size; ++k) {
      const size_t byte = format_ == Format::kBigEndian ? k : size - 1 - k;
      value = value << 8 | static_cast<uint8_t>(content_[at_ + byte]);
    }
    at_ += size;
    return value;
  }

  const std::string& content_;
  const std::string& what_;
  size_t at_ = 0;
  Format format_ = Format::kText;
  std::vector<Element> elements_;
};

}  // namespace

std::string checked_ply(const std::string& content, const std::string& what) {
  return PlyCheck(content, what).run();
}

}  // namespace itn
