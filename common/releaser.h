// For std::unique_ptr of what C libraries allocate.
#pragma once

namespace itn {

// Calls `release`, e.g. X509_free.
template <auto release>
struct Releaser {
  template <typename T>
  void operator()(T* object) const {
    release(object);
  }
};

}  // namespace itn
