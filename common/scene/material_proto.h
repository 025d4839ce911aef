// Materials as messages.
#pragma once

#include "common/material.h"
#include "itn/v1/scene.pb.h"

namespace itn {

inline v1::Material to_proto(const Material& material) {
  v1::Material proto;
  proto.set_sigma_t(material.sigma_t);
  proto.set_albedo(material.albedo);
  proto.set_g(material.g);
  return proto;
}

inline Material from_proto(const v1::Material& proto) {
  return {proto.sigma_t(), proto.albedo(), proto.g()};
}

}  // namespace itn
