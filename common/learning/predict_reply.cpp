#include "common/learning/predict_reply.h"

#include <variant>

#include "common/error.h"
#include "common/rpc/status.h"
#include "common/scene/material_proto.h"

namespace itn {
namespace {

v1::ParameterPosterior to_proto(const ParameterPosterior& p) {
  v1::ParameterPosterior proto;
  proto.set_mean(p.mean);
  proto.set_standard_deviation(p.standard_deviation);
  proto.set_median(p.median);
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
  *proto.mutable_diffuse_albedo() = to_proto(posterior.diffuse_albedo);
  *proto.mutable_diffusion_length() = to_proto(posterior.diffusion_length);
  for (size_t pair = 0; pair < 3; ++pair) {
    proto.add_correlations(posterior.material.correlations[pair]);
    proto.add_scattering_correlations(posterior.scattering.correlations[pair]);
  }
  return proto;
}

}  // namespace

v1::PredictReply to_reply(std::span<const MaterialEstimate> estimates,
                          const v1::ModelVersion& model) {
  v1::PredictReply reply;
  for (const MaterialEstimate& estimate : estimates) {
    *reply.add_materials() = itn::to_proto(estimate.material);
    if (estimate.posterior) *reply.add_posteriors() = to_proto(*estimate.posterior);
    v1::AnswerWarnings& caveats = *reply.add_caveats();
    for (const v1::MaterialBound bound : estimate.at_bounds) caveats.add_at_bounds(bound);
    if (estimate.outlier) {
      v1::OutlierScore& outlier = *caveats.mutable_outlier();
      outlier.set_score(estimate.outlier->score);
      outlier.set_rank(estimate.outlier->rank);
      outlier.set_is_outlier(estimate.outlier->is_outlier);
      outlier.set_reason(estimate.outlier->reason);
    }
    caveats.mutable_warnings()->Assign(estimate.warnings.begin(), estimate.warnings.end());
  }
  reply.set_model(name(model));
  *reply.mutable_model_version() = model;
  return reply;
}

v1::PredictBatchReply to_reply(const Predictor::Outcomes& outcomes, const v1::ModelVersion& model) {
  v1::PredictBatchReply reply;
  for (const Predictor::Outcome& outcome : outcomes.each) {
    v1::PredictOutcome& proto = *reply.add_outcomes();
    if (const Error* error = std::get_if<Error>(&outcome)) {
      const grpc::Status status = to_status(*error);
      proto.set_code(status.error_code());
      proto.set_message(status.error_message());
    } else {
      *proto.mutable_reply() = to_reply(std::get<std::vector<MaterialEstimate>>(outcome), model);
    }
  }
  if (!outcomes.combined.empty()) *reply.mutable_combined() = to_reply(outcomes.combined, model);
  return reply;
}

}  // namespace itn
