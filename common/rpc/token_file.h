// The secret by which a server knows its clients, in a file: whoever may read the file may call.
#pragma once

#include <mutex>
#include <string>
#include <vector>

#include "common/files/file_stamp.h"

namespace itn {

// The tokens of a file, one a line, of 16 to 4,096 printable ASCII characters without spaces; empty
// lines do not count. A server takes any of them, a client shows the first: to change a token
// without an interruption, the servers' file gets the new one beside the old for a while. Read
// again when the file has changed; if it cannot be used then, the former tokens stay, with a
// warning. Tokens are in no message and no log. Thread-safe.
class TokenFile {
 public:
  // Throws Error: kIo if the file cannot be read, kInvalidInput if there is no such token in it.
  explicit TokenFile(std::string path);

  // What a client sends as `authorization`: "Bearer TOKEN".
  std::string header();

  // Whether `header` is that of one of the tokens. Takes the same time whatever it is.
  bool admits(const std::string& header);

 private:
  void read();           // throws as the constructor
  void read_if_newer();  // with the mutex

  const std::string path_;
  std::mutex mutex_;
  FileStamp stamp_;
  std::string first_;                 // the header of the first
  std::vector<std::string> digests_;  // of the headers
};

}  // namespace itn
