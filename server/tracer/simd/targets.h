// The instruction sets that the tracer is compiled for: those with fused multiply-add that Highway
// knows, and none at all. Included before all of Highway.
#pragma once

#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SSE4)
// Without any, one lane at a time: emulated vectors, which some compilers get, round twice.
#define HWY_BROKEN_EMU128 1
