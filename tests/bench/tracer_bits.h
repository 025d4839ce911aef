// Digests of renders: what must stay the same, bit for bit, while the tracer is rewritten.
#pragma once

namespace itn {

// Prints a line for each scene, kind of request and tracer: of the wavefront for each set of
// instructions that this processor has. Two builds of the same bits print the same lines.
void print_bits();

}  // namespace itn
