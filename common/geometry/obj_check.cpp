#include "common/geometry/obj_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "common/error.h"
#include "common/geometry/plain_number.h"

namespace itn {
namespace {

class ObjCheck {
 public:
  ObjCheck(std::string_view content, const std::string& what) : rest_(content), what_(what) {}

  std::string run() {
    while (!rest_.empty()) {
      read_words();
      if (words_.empty()) continue;
      if (words_.front() == "v") copy_vertex();
      if (words_.front() == "f") copy_face();
    }
    if (greatest_ == 0) throw invalid_input(what_ + ": it has no faces");
    if (greatest_ > vertices_) throw missing_vertex(greatest_at_, greatest_);
    return std::move(result_);
  }

 private:
  Error wrong(size_t line, const std::string& reason) const {
    return invalid_input(fmt::format("{}: line {}: {}", what_, line, reason));
  }
  Error missing_vertex(size_t line, int64_t vertex) const {
    return wrong(line,
                 fmt::format("the face refers to vertex {}; there are {}", vertex, vertices_));
  }

  // Of the next line up to a comment, and of those that a backslash at its end joins to it. One at
  // the end of a comment, as of a path of Windows, joins nothing: a vertex would vanish.
  void read_words() {
    words_.clear();
    for (bool joined = true; joined && !rest_.empty();) {
      ++line_;
      std::string_view text = rest_.substr(0, rest_.find('\n'));
      rest_.remove_prefix(std::min(rest_.size(), text.size() + 1));
      if (text.ends_with('\r')) text.remove_suffix(1);
      const size_t comment = text.find('#');
      joined = comment == std::string_view::npos && text.ends_with('\\');
      if (joined) text.remove_suffix(1);
      split(text.substr(0, comment));
    }
  }

  void split(std::string_view text) {
    constexpr std::string_view kSpaces = " \t\v\f\r";
    for (;;) {
      text.remove_prefix(std::min(text.size(), text.find_first_not_of(kSpaces)));
      if (text.empty()) return;
      words_.push_back(text.substr(0, text.find_first_of(kSpaces)));
      text.remove_prefix(words_.back().size());
    }
  }

  // x, y, z; or with a fourth, by which they are divided. More are a colour.
  void copy_vertex() {
    const size_t numbers = words_.size() == 5 ? 4 : 3;
    if (words_.size() <= numbers) throw wrong(line_, "the vertex has less than three coordinates");
    result_ += 'v';
    for (size_t i = 1; i <= numbers; ++i) {
      const std::optional<std::string_view> number = plain_number(words_[i]);
      if (!number) {
        throw wrong(line_, fmt::format("there is \"{}\" where a number should be",
                                       words_[i].substr(0, kMaxNumber)));
      }
      result_.append(" ").append(*number);
    }
    result_ += '\n';
    ++vertices_;
  }

  // Of points and lines, which have fewer corners, nothing is made.
  void copy_face() {
    if (words_.size() < 4) return;
    if (words_.size() > kMaxCorners + 1) {
      throw wrong(line_, fmt::format("the face has {} corners; it may have at most {}",
                                     words_.size() - 1, kMaxCorners));
    }
    result_ += 'f';
    for (size_t i = 1; i < words_.size(); ++i) result_ += fmt::format(" {}", vertex(words_[i]));
    result_ += '\n';
  }

  // Of a corner v, v/vt, v//vn or v/vt/vn: counted from 1, or backwards from -1, the latest.
  int64_t vertex(std::string_view corner) {
    const std::string_view word = corner.substr(0, corner.find('/'));
    int64_t given = 0;
    const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), given);
    if (error == std::errc::invalid_argument || end != word.data() + word.size()) {
      throw wrong(line_,
                  fmt::format("the face has the corner \"{}\"", corner.substr(0, kMaxNumber)));
    }
    if (error != std::errc() || given == 0 || given < -vertices_) {
      throw missing_vertex(line_, given);
    }
    const int64_t number = given > 0 ? given : vertices_ + 1 + given;
    if (number > greatest_) {
      greatest_ = number;  // it may follow
      greatest_at_ = line_;
    }
    return number;
  }

  std::string_view rest_;
  const std::string& what_;
  size_t line_ = 0;
  std::vector<std::string_view> words_;
  int64_t vertices_ = 0, greatest_ = 0;
  size_t greatest_at_ = 0;
  std::string result_;
};

}  // namespace

std::string checked_obj(const std::string& content, const std::string& what) {
  return ObjCheck(content, what).run();
}

}  // namespace itn
