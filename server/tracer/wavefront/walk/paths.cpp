#include "server/tracer/wavefront/walk/paths.h"

#include "common/fields.h"

namespace itn::tracer {

PathRecorder::PathRecorder(const RenderRequest& request, const Paths& paths, FilmWriter& film)
    : paths_(paths), film_(film) {
  if (!request.colours.empty()) return;
  for (size_t d = 0; d < request.derivatives.size(); ++d) {
    const Parameter& parameter = request.derivatives[d];
    switch (parameter.kind) {
      case Parameter::kPhase: {
        const size_t slot = slots_of<PhaseFunction>()[parameter.slot].number;
        derivatives_.push_back({d, &paths.d_slots[slot], &paths.control_phase[slot]});
        break;
      }
      case Parameter::kBoundary: {
        const size_t slot = slots_of<Boundary>()[parameter.slot].number;
        derivatives_.push_back({d, &paths.d_slots[paths.control_phase.size() + slot]});
        break;
      }
      case Parameter::kSigmaT:
      case Parameter::kAlbedo:
      case Parameter::kReflectance:
      case Parameter::kLightPlace:
      case Parameter::kLightScale: break;  // Collected
    }
  }
}

PathEstimate& PathRecorder::read(size_t slot) {
  estimate_.hit = paths_.hit[slot] != 0;
  estimate_.leaked = paths_.leaked[slot] != 0;
  estimate_.steps = paths_.steps[slot];
  estimate_.radiance = paths_.radiance[slot];
  const float expected = paths_.expected[slot];
  for (const auto& [number, collected, control_variate] : derivatives_) {
    estimate_.derivatives[number] = control_variate != nullptr
                                        ? (*collected)[slot] - expected * (*control_variate)[slot]
                                        : (*collected)[slot];
  }
  return estimate_;
}

void PathRecorder::record(size_t slot) {
  film_.add({paths_.pixel[slot], paths_.sample[slot], paths_.expected[slot]}, estimate_);
}

}  // namespace itn::tracer
