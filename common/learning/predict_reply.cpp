#include "common/learning/predict_reply.h"

#include "common/scene/material_proto.h"

namespace itn {
namespace {

v1::ParameterPosterior to_proto(const ParameterPosterior& p) {
  v1::ParameterPosterior proto;
  proto.set_mean(p.mean);
  proto.set_standard_deviation(p.standard_deviation);
  proto.set_low(p.low);
  proto.set_high(p.high);
  return proto;
}

v1::MaterialPosterior to_proto(const Posterior& posterior) {
  v1::MaterialPosterior proto;
  const auto& m = posterior.material.parameters;
  const auto& s = posterior.scattering.parameters;
  *proto.mutable_sigma_t() = to_proto(m[0]);
  *proto.mutable_albedo() = to_proto(m[1]);
  *proto.mutable_g() = to_proto(m[2]);
  *proto.mutable_sigma_a() = to_proto(s[0]);
  *proto.mutable_sigma_s() = to_proto(s[1]);
  *proto.mutable_sigma_s_reduced() = to_proto(s[2]);
  for (size_t pair = 0; pair < 3; ++pair) {
    proto.add_correlations(posterior.material.correlations[pair]);
    proto.add_scattering_correlations(posterior.scattering.correlations[pair]);
  }
  return proto;
}

}  // namespace

v1::PredictReply to_reply(std::span<const MaterialEstimate> estimates, const std::string& model) {
  v1::PredictReply reply;
  for (const MaterialEstimate& estimate : estimates) {
    *reply.add_materials() = itn::to_proto(estimate.material);
    if (estimate.posterior) {
      *reply.add_posteriors() = to_proto(*estimate.posterior);
    }
  }
  reply.set_model(model);
  return reply;
}

}  // namespace itn
