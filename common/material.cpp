#include "common/material.h"

#include "common/fields.h"

namespace itn {

void validate(const Material& material, const std::string& what) {
  in_closed(what + ".sigma_t", material.sigma_t, kMinSigmaT, kMaxSigmaT);
  in_closed(what + ".albedo", material.albedo, 0, 1);
  in_closed(what + ".g", material.g, -kMaxAbsG, kMaxAbsG);
}

}  // namespace itn
