// A bound on the memory that a test may ask for.
#pragma once

#include <sys/resource.h>
#include <unistd.h>

#include <fstream>

namespace itn::testing {

// While it is there, this process can have so many bytes of address space more than it had: larger
// allocations fail. Without effect under the address sanitizer, whose shadow does not fit.
class AddressSpaceLimit {
 public:
  explicit AddressSpaceLimit([[maybe_unused]] size_t more) {
    getrlimit(RLIMIT_AS, &before_);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
    std::ifstream statm("/proc/self/statm");
    size_t pages = 0;
    statm >> pages;
    const rlimit limit{pages * static_cast<size_t>(sysconf(_SC_PAGESIZE)) + more, before_.rlim_max};
    setrlimit(RLIMIT_AS, &limit);
#endif
  }
  ~AddressSpaceLimit() {
    setrlimit(RLIMIT_AS, &before_);
  }
  AddressSpaceLimit(const AddressSpaceLimit&) = delete;
  AddressSpaceLimit& operator=(const AddressSpaceLimit&) = delete;

 private:
  rlimit before_{};
};

}  // namespace itn::testing
