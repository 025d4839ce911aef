// To be preloaded (LD_PRELOAD): memory of posix_memalign(), which LibTorch's tensors and oneDNN's
// buffers are made of, with pages around it that nobody may touch. Generated code, which no
// sanitizer sees, ends the process by SIGSEGV where it reads or writes 64 bytes or more beyond it;
// at a write nearer to its end the process is aborted when the memory is freed.
#include <dlfcn.h>
#include <sys/mman.h>
#include <unistd.h>
#include <cerrno>

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string_view>

namespace {

constexpr size_t kPage = 4096;
constexpr size_t kGuard = 16 * kPage;  // at each end
constexpr size_t kAlignment = 64;      // at least
constexpr uint64_t kMark = 0x5afec0de12345678;
constexpr unsigned char kUnused = 0xCD;

// A guard, whole pages with the block at their end, a guard. The header is just before the block.
struct alignas(kAlignment) Header {
  uint64_t mark;
  size_t size;    // of the block, as it was asked for
  char* mapping;  // all of it
  size_t mapped;
};

size_t rounded_up(size_t size, size_t to) {
  return (size + to - 1) / to * to;
}

// The block's last bytes up to the guard.
bool is_as_it_was(const Header& header, const char* block) {
  const char* guard = header.mapping + header.mapped - kGuard;
  return std::all_of(block + header.size, guard,
                     [](char byte) { return static_cast<unsigned char>(byte) == kUnused; });
}

[[noreturn]] void abort_with(std::string_view message) {
  [[maybe_unused]] const ssize_t written = ::write(STDERR_FILENO, message.data(), message.size());
  std::abort();
}

}  // namespace

extern "C" {

int posix_memalign(void** memory, size_t alignment, size_t size) noexcept {
  alignment = std::max(alignment, kAlignment);
  if (alignment > kPage) return EINVAL;
  const size_t block = rounded_up(size, alignment);
  const size_t pages = rounded_up(block + sizeof(Header), kPage);
  const size_t mapped = pages + 2 * kGuard;
  void* const mapping = ::mmap(nullptr, mapped, PROT_NONE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (mapping == MAP_FAILED) return ENOMEM;
  char* const first = static_cast<char*>(mapping) + kGuard;
  if (::mprotect(first, pages, PROT_READ | PROT_WRITE) != 0) return ENOMEM;
  char* const start = first + pages - block;
  std::fill(start + size, first + pages, static_cast<char>(kUnused));
  *reinterpret_cast<Header*>(start - sizeof(Header)) = {kMark, size, static_cast<char*>(mapping),
                                                        mapped};
  *memory = start;
  return 0;
}

void free(void* memory) noexcept {
  static const auto real = reinterpret_cast<void (*)(void*)>(::dlsym(RTLD_NEXT, "free"));
  if (memory == nullptr) return;
  if (reinterpret_cast<uintptr_t>(memory) % kAlignment == 0) {
    const Header header = *reinterpret_cast<Header*>(static_cast<char*>(memory) - sizeof(Header));
    if (header.mark == kMark) {
      if (!is_as_it_was(header, static_cast<char*>(memory))) {
        abort_with("memory was written to beyond its end\n");
      }
      ::munmap(header.mapping, header.mapped);
      return;
    }
  }
  real(memory);
}

}  // extern "C"
