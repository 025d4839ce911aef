// The medium and what is around it have one index of refraction: light passes as if there were no
// boundary, and nobody asks what it does.
#pragma once

namespace itn::tracer {

struct IndexMatched {
  static constexpr const char* kName = "";
  template <typename Self, typename Fields>
  static void fields(Self& /*self*/, Fields& /*to*/) {}

  IndexMatched compile() const { return *this; }

  static constexpr bool kStopsLines = false, kDelta = true;
  double relative_index() const { return 1; }
};

}  // namespace itn::tracer
