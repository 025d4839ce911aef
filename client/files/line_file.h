// A file that grows line by line.
#pragma once

#include <filesystem>
#include <string>

#include "common/files/file_descriptor.h"

namespace itn {

class LineFile {
 public:
  // Goes on at the end of one that is there, or makes one. Throws Error (kIo).
  explicit LineFile(std::filesystem::path path);

  // Adds a line, which has no end yet: in the file after the next flush().
  void add(const std::string& line) { missing_ += line + '\n'; }

  // Throws Error (kIo), e.g. of a full disk: the next call goes on with what is missing.
  void flush();

 private:
  std::filesystem::path path_;
  FileDescriptor file_;
  std::string missing_;
};

}  // namespace itn
