// The instruction sets that the tracer is compiled for: those with fused multiply-add that Highway
// knows, and none at all. Included before all of Highway, by files that compute with lanes: for
// them, headers of kinds define what the kinds compute, too.
#pragma once

#define ITN_KERNEL 1

#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SSE4)
// Without any, one lane at a time: emulated vectors, which some compilers get, round twice.
#define HWY_BROKEN_EMU128 1
