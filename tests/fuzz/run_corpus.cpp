// Runs a fuzz target without libFuzzer: every file of its corpus, then mutations of them.
//
// Usage: fuzz_NAME CORPUS_FOLDER MUTATIONS MAX_MEMORY_MB [FIRST]. Mutation number i, counted from
// FIRST (0), is the same in every run. Exit code 1 if the folder is empty, one of its files is not
// accepted although its name does not begin with "refused", or the process has had more resident
// memory. A process that ends otherwise says at which input.
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <random>
#include <string>
#include <vector>

#include "common/files/read_file.h"
#include "tests/fuzz/fuzz_target.h"

extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t max_size);
// The mutator of targets that have one.
extern "C" __attribute__((weak)) size_t LLVMFuzzerCustomMutator(uint8_t* data, size_t size,
                                                                size_t max_size, unsigned seed);

namespace {

namespace fs = std::filesystem;

// An input takes a thousandth of this.
constexpr unsigned kMaxSeconds = 120;
constexpr size_t kMaxMore = 1024;  // bytes that a mutation may add

std::mt19937 byte_mutations;
char current_input[512];

void tell_input(int number) {
  const char* const parts[] = {"fuzz: signal ", strsignal(number), ", at ", current_input, "\n"};
  for (const char* part : parts) {
    if (write(STDERR_FILENO, part, std::strlen(part)) < 0) break;
  }
  signal(number, SIG_DFL);
  raise(number);
}

size_t below(size_t n) {
  return std::uniform_int_distribution<size_t>(0, n - 1)(byte_mutations);
}

void run(const std::string& input) {
  // A copy of its own, so that a sanitizer sees reads beyond its end.
  const std::vector<uint8_t> bytes(input.begin(), input.end());
  alarm(kMaxSeconds);
  LLVMFuzzerTestOneInput(bytes.data(), bytes.size());
  alarm(0);
}

std::string mutated(const std::string& whole, unsigned seed) {
  byte_mutations.seed(seed);
  std::string bytes = whole;
  bytes.resize(whole.size() + kMaxMore);
  auto* const data = reinterpret_cast<uint8_t*>(bytes.data());
  const auto mutate = [&](size_t size) {
    return LLVMFuzzerCustomMutator != nullptr
               ? LLVMFuzzerCustomMutator(data, size, bytes.size(), seed)
               : LLVMFuzzerMutate(data, size, bytes.size());
  };
  bytes.resize(mutate(whole.size()));
  return bytes;
}

long peak_megabytes() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_maxrss / 1024;
}

}  // namespace

// Some bytes changed, half of them near the start, where headers are; sometimes cut or grown.
extern "C" size_t LLVMFuzzerMutate(uint8_t* data, size_t size, size_t max_size) {
  std::string bytes(reinterpret_cast<const char*>(data), size);
  if (bytes.empty()) bytes.push_back('\0');
  for (size_t i = 1 + below(8); i > 0; --i) {
    constexpr size_t kHeader = 400;
    const size_t end = below(2) ? bytes.size() : std::min(bytes.size(), kHeader);
    static constexpr unsigned char kExtremes[] = {0x00, 0x01, 0x7f, 0x80, 0xff};
    bytes[below(end)] = static_cast<char>(below(2) ? kExtremes[below(5)] : below(256));
  }
  if (below(4) == 0) bytes.resize(1 + below(bytes.size()));
  if (below(8) == 0) bytes.insert(below(bytes.size()), bytes.substr(below(bytes.size())));
  bytes.resize(std::min(bytes.size(), max_size));
  std::ranges::copy(bytes, data);
  return bytes.size();
}

int main(int argc, char** argv) {
  if (argc < 4) {
    std::fprintf(stderr, "usage: %s CORPUS_FOLDER MUTATIONS MAX_MEMORY_MB [FIRST]\n", argv[0]);
    return 2;
  }
  const auto count = static_cast<unsigned>(std::atoi(argv[2]));
  const long most_megabytes = std::atol(argv[3]);
  const auto first = static_cast<unsigned>(argc > 4 ? std::atoi(argv[4]) : 0);
  for (const int number : {SIGABRT, SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGALRM}) {
    signal(number, tell_input);
  }
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(argv[1])) files.push_back(entry.path());
  std::ranges::sort(files);
  std::vector<std::string> inputs;
  bool all_as_expected = !files.empty();
  for (const fs::path& file : files) {
    std::snprintf(current_input, sizeof current_input, "%s", file.c_str());
    const auto before = itn::testing::accepted;
    run(inputs.emplace_back(itn::read_file(file, "input")));
    if (itn::testing::accepted == before && !file.filename().string().starts_with("refused")) {
      std::fprintf(stderr, "%s is not accepted\n", file.c_str());
      all_as_expected = false;
    }
  }
  const auto accepted = itn::testing::accepted;
  for (unsigned i = first; i < first + count && !files.empty(); ++i) {
    const size_t which = i % files.size();
    std::snprintf(current_input, sizeof current_input, "mutation %u, of %s; again: %s %s 1 %ld %u",
                  i, files[which].c_str(), argv[0], argv[1], most_megabytes, i);
    run(mutated(inputs[which], i));
  }
  std::printf("%zu files, %llu times accepted; %u mutations, %llu times accepted; peak %ld MB\n",
              files.size(), static_cast<unsigned long long>(accepted), count,
              static_cast<unsigned long long>(itn::testing::accepted - accepted), peak_megabytes());
  return all_as_expected && peak_megabytes() <= most_megabytes ? 0 : 1;
}
