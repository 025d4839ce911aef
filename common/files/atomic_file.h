// Files that appear under their name only when they are complete.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

namespace itn {

// Replaces a regular file, or creates one: written under a temporary name beside it and renamed, so
// that a reader sees the old file or the new one, never a part, even if the process or the machine
// stops in between. A file that is replaced leaves its permissions, and its owner where that is
// allowed, to the new one; a file that must not be written (read-only) is not replaced. Where
// `target` is a symbolic link, the file that it leads to is meant, also if that is not there yet.
//
// What is no regular file is written into as it is: a device, a FIFO (which waits for its reader),
// and standard output, under the name "-" or any other. Folders are refused. Throws Error (kIo).
void write_file_atomically(const std::filesystem::path& target, std::string_view bytes);

// Throws the Error (kIo) that writing the target would end with, as far as that can be known, and
// changes nothing: to be called before the work whose result goes there.
void check_writable(const std::filesystem::path& target);

// Checks the same for a folder that files are going to be created in, and which need not exist yet.
void check_folder_writable(const std::filesystem::path& folder);

// For messages: "standard output" for "-".
std::string name_of_output(const std::filesystem::path& target);

// Whether the target is standard output: "-", or a name of the file or pipe that it leads to.
bool is_stdout(const std::filesystem::path& target);

}  // namespace itn
