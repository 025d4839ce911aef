// The most that one render may be asked for. Workers refuse more.
#pragma once

#include <cstddef>
#include <cstdint>

namespace itn {

inline constexpr uint32_t kMaxSamples = 1U << 20;  // per pixel
inline constexpr uint32_t kMaxEstimates = 16;      // independent ones
inline constexpr uint32_t kMaxPilotSpp = 64;       // samples per pixel of a pilot
inline constexpr size_t kMaxAlbedos = 16;          // further ones, from the same paths
inline constexpr size_t kMaxDerivatives = 32;      // images of them, in all colours together
// The size of a weight is limited so that gradients are finite as floats.
inline constexpr double kMaxGradientWeight = 1e15;

}  // namespace itn
