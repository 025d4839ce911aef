// The radiance is an integral over paths x,
//
//   T(pi) = integral of f(x; pi) dx,    f = L_e * product of the factors along the path,
//
// and its derivative that of f S with the score S = d log f / d pi, estimated with the same paths
// (Che et al., ICCP 2020, Eqs. 4-7). As paths are drawn with the current pi, the factors cancel
// against the densities, up to a weight, and the scores are running sums over the path:
//
//   free flight: density sigma_t exp(-sigma_t l) if it ends in a scattering, probability
//     exp(-sigma_t l) if it leaves the medium first, l being the length inside. So
//     S_sigma_t += 1/sigma_t - l, or -l;
//   scattering: factor albedo p(cos_theta; g). The weight W takes the albedo; S_g += d log p / dg;
//   albedo: W is a power of it, and dW/d albedo is carried along instead of a score, which would
//     divide by an albedo of 0;
//   the reflectance of a surface: likewise, dW/d reflectance;
//   the index of a rough boundary: a score, and since directions end where f is not 0, and that end
//     turns with the index, the light from there (BoundaryEdge), on paths that follow it;
//   the scale of a light, which is 1: f is linear in it, and the derivative is the part of the
//     radiance that this light sends;
//   a shadow ray has a segment and a scattering angle of its own, which add to the scores of its
//     contribution.
//
// Sampling densities, roulette and the weights of multiple importance sampling are functions of the
// current pi that are not differentiated: they only choose how the integral of f S is estimated.
#include "server/tracer/simd/targets.h"
// After targets.h:
#include <hwy/highway.h>

#include "server/tracer/reference/path.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <vector>

#include "common/error.h"
#include "common/fields.h"
#include "server/tracer/boundary/boundary.h"
#include "server/tracer/geometry/rays.h"
#include "server/tracer/geometry/surface_normals-inl.h"
#include "server/tracer/phase/phase_function.h"
#include "server/tracer/random/sampler.h"

namespace itn::tracer {
namespace {

using HWY_NAMESPACE::BoundarySample;
using HWY_NAMESPACE::BoundaryValue;
using HWY_NAMESPACE::Crossing;
using HWY_NAMESPACE::evaluate;
using HWY_NAMESPACE::reflectance_at;
using HWY_NAMESPACE::reflectance_slope;
using HWY_NAMESPACE::sample;
using HWY_NAMESPACE::sample_cosine;
using HWY_NAMESPACE::smooth_normal_at;
using HWY_NAMESPACE::hn::GetLane;

constexpr float kFloatPi = std::numbers::pi_v<float>;

// How many vertices of a path are visited between two looks at the stop token, the first look being
// at its start: well under a millisecond.
constexpr uint32_t kStopInterval = 512;

// By slot of the phase function, and behind them of the boundary.
using Scores = std::array<float, kMaxPhaseSlots + kMaxBoundarySlots>;
Scores sum(const Scores& a, const Scores& b) {
  Scores result;
  for (size_t s = 0; s < a.size(); ++s) result[s] = a[s] + b[s];
  return result;
}

class Walk {
 public:
  Walk(const Scene::Compiled& scene, const RenderRequest& request, const Switches& switches,
       const Sampler& sampler)
      : scene_(scene),
        request_(request),
        switches_(switches),
        sampler_(sampler),
        phase_slots_(slot_count(phase_of(request))),
        stops_at_boundary_(stops_lines(scene.boundary)),
        index_slot_(differentiated_index(request, scene.boundary)),
        geometry_(scene.geometry()) {
    enter(scene.camera_medium);
    for (size_t i = 0; i < request.derivatives.size(); ++i) {
      if (request.derivatives[i].kind == Parameter::kReflectance) reflectances_.push_back(i);
    }
  }

  PathEstimate run(int x, int y, const std::stop_token& stop) {
    start_at_camera(x, y);
    for (vertex_ = 1;; ++vertex_) {
      if (vertex_ % kStopInterval == 1 && stop.stop_requested()) {
        throw Error(ErrorKind::kCancelled, "the render was stopped");
      }
      const Uniforms u = sampler_.uniforms(vertex_, Sampler::kWalk);
      const RayResult ray = sample_flight(u[0]);
      switch (ray.end) {
        case RayResult::End::kLeaked: result_.leaked = true; return result_;
        case RayResult::End::kEscaped: add_escape(); return result_;
        case RayResult::End::kSurface: reflect(ray.at, u[1], u[2]); break;
        case RayResult::End::kInMedium: scatter(ray.at, u[1], u[2]); break;
        case RayResult::End::kCrossing: cross(ray); break;
      }
      if (result_.leaked || !russian_roulette(u[3])) return result_;
    }
  }

 private:
  // From now on the path is in this medium, or at its boundary: see Scene::Compiled::camera_medium.
  void enter(size_t medium) {
    of_object_ = medium == 0;
    const Material& material =
        of_object_ ? request_.material : scene_.other_media[medium - 1].material;
    sigma_t_ = static_cast<float>(material.sigma_t);
    albedo_ = static_cast<float>(material.albedo);
    phase_ = of_object_ ? phase_of(request_) : HenyeyGreenstein{static_cast<float>(material.g)};
    boundary_ = &scene_.boundary_of(medium);
  }

  void start_at_camera(int x, int y) {
    const Uniforms u = sampler_.uniforms(0, Sampler::kFilm);
    const CameraRay ray = scene_.camera_ray(x + double{u[0]}, y + double{u[1]});
    direction_ = ray.direction;
    at_ = {ray.origin, scene_.camera_inside, {}};
    weight_ = scene_.camera_weight;
    if (index_slot_) score_slots_[kMaxPhaseSlots + *index_slot_] = scene_.camera_score;
  }

  // One free flight. As flights are memoryless, one path length serves for all the parts of the
  // line that lie inside the medium.
  RayResult sample_flight(float u) {
    // Lamps are outside.
    const bool to_boundary = stops_at_boundary_ && at_.inside;
    const float distance = to_boundary ? std::numeric_limits<float>::infinity()
                                       : scene_.lights.reach(at_.position, direction_);
    const RayResult ray = geometry_.follow(at_, direction_, -std::log(1 - u) / sigma_t_,
                                           stops_at_boundary_, distance);
    if (ray.entered) {
      ++result_.steps;
      if (of_object_) score_sigma_t_ -= ray.medium_length;
    }
    if (of_object_ && ray.end == RayResult::End::kInMedium) {
      score_sigma_t_ += 1 / sigma_t_;
      ++scatterings_;
    }
    if (vertex_ == 1) result_.hit = ray.entered;
    return ray;
  }

  // Light that the walk meets by itself, at lamps or after leaving the scene.
  void add_escape() {
    const Lights& lights = scene_.lights;
    float mis_weight = 1;
    if (use_mis_) {
      switch (switches_.techniques) {
        case Switches::Techniques::kLightsOnly: return;
        case Switches::Techniques::kPhaseOnly: break;
        case Switches::Techniques::kBoth:
          mis_weight = pdf_ / (pdf_ + lights.pdf(direction_, at_.position));
          break;
      }
    }
    add(lights.radiance(direction_, at_.position) * mis_weight, score_sigma_t_, score_slots_,
        [&](size_t light) {
          return lights.radiance_of(light, direction_, at_.position) * mis_weight;
        });
  }

  // A scattering in the medium: sends a shadow ray, then draws the next direction.
  void scatter(const Interaction& here, float u0, float u1) {
    dweight_dalbedo_ = dweight_dalbedo_ * albedo_ + (of_object_ ? weight_ : 0);
    weight_ *= albedo_;
    edge_weight_ *= albedo_;
    for (const size_t i : reflectances_) dweight_dreflectance_[i] *= albedo_;
    at_ = here;
    send_shadow_ray([&](Vec3f to_light) {
      const auto [value, scores] = at_angle(dot(direction_, to_light));
      return Response{value, value, scores};
    });

    const float cosine = GetLane(sample_cosine(phase_, HWY_NAMESPACE::set(u0)));
    const float sine = std::sqrt(std::max(0.0F, 1 - cosine * cosine));
    const float phi = 2 * kFloatPi * u1;
    direction_ = itn::normalize(
        Basis<float>(direction_).to_world(sine * std::cos(phi), sine * std::sin(phi), cosine));
    const auto [value, scores] = at_angle(cosine);
    pdf_ = value;
    score_slots_ = sum(score_slots_, scores);
    use_mis_ = true;
    crossings_ = 0;
  }

  // A diffuse reflection: likewise, with the cosine law.
  void reflect(const Interaction& here, float u0, float u1) {
    const Reflectance& kind = scene_.surfaces[here.on.surface].reflectance;
    const auto position = HWY_NAMESPACE::set(here.position);
    const float reflectance = GetLane(reflectance_at(kind, position));
    for (const size_t i : reflectances_) {
      const Parameter& parameter = request_.derivatives[i];
      const size_t slot = slots_of<Reflectance>()[parameter.slot].number;
      const float slope =
          parameter.index == here.on.surface ? GetLane(reflectance_slope(kind, slot, position)) : 0;
      dweight_dreflectance_[i] = dweight_dreflectance_[i] * reflectance + slope * weight_;
    }
    weight_ *= reflectance;
    dweight_dalbedo_ *= reflectance;
    edge_weight_ *= reflectance;
    const Vec3f flat_normal = geometry_.facing_normal(here.on, direction_);
    const Vec3f normal = smooth_normal(here, flat_normal);
    at_ = here;
    send_shadow_ray([&](Vec3f to_light) {
      const bool above = dot(flat_normal, to_light) > 0;
      const float pdf = above ? std::max(0.0F, dot(normal, to_light)) / kFloatPi : 0;
      return Response{pdf, pdf, {}};
    });

    const float cosine = std::sqrt(1 - u0);  // density cosine / pi: cosine^2 is uniform
    const float sine = std::sqrt(u0);
    const float phi = 2 * kFloatPi * u1;
    direction_ = itn::normalize(
        Basis<float>(normal).to_world(sine * std::cos(phi), sine * std::sin(phi), cosine));
    pdf_ = cosine / kFloatPi;
    use_mis_ = true;
    crossings_ = 0;
    if (!(dot(flat_normal, direction_) > 0)) multiply_weight(0);
  }

  // The normal of a smooth surface, on the side of its triangle's.
  Vec3f smooth_normal(const Interaction& here, Vec3f flat_normal) const {
    const Surfaces& surfaces = scene_.obstacles.surfaces;
    if (!surfaces.smooth()) return flat_normal;
    const uint32_t number = surfaces.first_triangle_of_mesh[here.on.surface] + here.on.triangle;
    const auto lane = smooth_normal_at(
        surfaces, HWY_NAMESPACE::hn::Set(HWY_NAMESPACE::IntTag(), static_cast<int32_t>(number)),
        HWY_NAMESPACE::set(here.position));
    const Vec3f normal{GetLane(lane.x), GetLane(lane.y), GetLane(lane.z)};
    return dot(surfaces.normals.at(number), flat_normal) < 0 ? -normal : normal;
  }

  // The boundary reflects the path or lets it through.
  void cross(const RayResult& ray) {
    if (++crossings_ > kMaxConsecutiveCrossings) {
      result_.leaked = true;
      return;
    }
    enter(scene_.medium_at(ray.triangle));
    const bool leaving = ray.at.inside;
    const CornerNormals& normals = scene_.obstacles.corner_normals;
    const Crossing crossing = crossing_of(
        HWY_NAMESPACE::set(direction_),
        HWY_NAMESPACE::set(normals.at(ray.triangle, ray.v, ray.w, ray.normal)),
        HWY_NAMESPACE::set(ray.normal), FirstN(HWY_NAMESPACE::FloatTag(), leaving ? 1 : 0),
        normals.flat(), {.index = of_object_ && index_slot_.has_value()});
    at_ = {ray.at.position, false, {}};
    if (!is_delta(*boundary_)) {
      send_shadow_ray([&](Vec3f to_light) {
        if (!(dot(ray.normal, to_light) > 0)) return Response{};
        const BoundaryValue light = evaluate(*boundary_, crossing, HWY_NAMESPACE::set(to_light));
        return Response{GetLane(light.value), GetLane(light.pdf), boundary_scores(light.scores)};
      });
    }
    const RandomWords words = sampler_.words(vertex_, Sampler::kBoundary);
    const BoundarySample next = sample(*boundary_, crossing, HWY_NAMESPACE::set(words));
    const float edge = weight_ * GetLane(next.edge_weight);
    at_.inside = leaving != AllTrue(HWY_NAMESPACE::FloatTag(), next.transmitted);
    at_.at_boundary = true;
    at_.normal = ray.normal;
    direction_ = {GetLane(next.direction.x), GetLane(next.direction.y), GetLane(next.direction.z)};
    multiply_weight(GetLane(next.weight));
    edge_weight_ += edge;
    score_slots_ = sum(score_slots_, boundary_scores(next.scores));
    pdf_ = GetLane(next.pdf);
    use_mis_ = !is_delta(*boundary_) && !(edge > 0);
  }

  // By a factor that no derivative is asked for in.
  void multiply_weight(float factor) {
    weight_ *= factor;
    dweight_dalbedo_ *= factor;
    edge_weight_ *= factor;
    for (const size_t i : reflectances_) dweight_dreflectance_[i] *= factor;
  }

  // What a vertex does with light from a direction.
  struct Response {
    float value;    // fraction scattered per steradian, the weight apart
    float pdf;      // with which the walk would go there by itself, per steradian
    Scores scores;  // d log value / d slot
  };

  // The scores of the object's boundary alone.
  Scores boundary_scores(const HWY_NAMESPACE::Floats (&by_slot)[kMaxBoundarySlots]) const {
    Scores result{};
    for (size_t s = 0; of_object_ && s < kMaxBoundarySlots; ++s) {
      result[kMaxPhaseSlots + s] = GetLane(by_slot[s]);
    }
    return result;
  }

  // What the phase function says of an angle.
  struct AtAngle {
    float value;
    Scores scores;
  };
  AtAngle at_angle(float cosine) const {
    const auto lane = evaluate(phase_, HWY_NAMESPACE::set(cosine));
    AtAngle result{GetLane(lane.value), {}};
    for (size_t s = 0; of_object_ && s < phase_slots_; ++s) {
      result.scores[s] = GetLane(lane.scores[s]);
    }
    return result;
  }

  // Next-event estimation: light along one direction drawn from the lights, dimmed by the medium.
  template <typename RespondTo>
  void send_shadow_ray(const RespondTo& respond_to) {
    if (switches_.techniques == Switches::Techniques::kPhaseOnly) return;
    if (at_.inside && stops_at_boundary_) return;  // it would end there
    const LightSample light =
        scene_.lights.sample(at_.position, sampler_.words(vertex_, Sampler::kShadowRay),
                             sampler_.words(vertex_, Sampler::kMap));
    const Response response = respond_to(light.direction);
    if (!(light.weight * response.value > 0)) return;
    const bool competes = light.pdf > 0 && switches_.techniques == Switches::Techniques::kBoth;
    const float mis_weight = competes ? light.pdf / (light.pdf + response.pdf) : 1;

    const RayResult ray = geometry_.follow(at_, light.direction, kMaxOpticalDepth / sigma_t_,
                                           stops_at_boundary_, light.distance);
    if (ray.end == RayResult::End::kLeaked) result_.leaked = true;
    if (ray.end != RayResult::End::kEscaped) return;
    const float dimming = std::exp(-sigma_t_ * ray.medium_length);
    const auto arriving = [&](float weight) {
      return weight * response.value * mis_weight * dimming;
    };
    add(arriving(light.weight), score_sigma_t_ - ray.medium_length,
        sum(score_slots_, response.scores), [&](size_t number) {
          return arriving(scene_.lights.weight_of(number, light, at_.position));
        });
  }

  // Adds light that arrives along the path with the given scores; part_of(k) is that of light k.
  template <typename PartOf>
  void add(float light, float score_sigma_t, const Scores& score_slots, const PartOf& part_of) {
    const double contribution = double{weight_} * double{light};
    result_.radiance += contribution;
    for (size_t i = 0; i < request_.derivatives.size(); ++i) {
      double& derivative = result_.derivatives[i];
      switch (request_.derivatives[i].kind) {
        case Parameter::kSigmaT: derivative += contribution * double{score_sigma_t}; break;
        case Parameter::kAlbedo: derivative += double{dweight_dalbedo_} * double{light}; break;
        case Parameter::kPhase: {
          const size_t slot = slots_of<PhaseFunction>()[request_.derivatives[i].slot].number;
          derivative += contribution * double{score_slots[slot]};
          break;
        }
        case Parameter::kBoundary: {
          const size_t slot = slots_of<Boundary>()[request_.derivatives[i].slot].number;
          derivative += contribution * double{score_slots[kMaxPhaseSlots + slot]};
          if (slot == index_slot_) derivative += double{edge_weight_} * double{light};
          break;
        }
        case Parameter::kReflectance:
          derivative += double{dweight_dreflectance_[i]} * double{light};
          break;
        case Parameter::kLightPlace: break;  // refused
        case Parameter::kLightScale:
          derivative += double{weight_} * double{part_of(request_.derivatives[i].index)};
          break;
        case Parameter::kScattered:
          if (scatterings_ == request_.derivatives[i].index) derivative += contribution;
          break;
      }
    }
  }

  // Russian roulette: a path of low weight ends, or goes on with the weight of those that ended.
  // Where reflectances are differentiated, a path is worth the derivative of its weight too: behind
  // a black surface that is all there is.
  bool russian_roulette(float u) {
    float importance = std::max(weight_, edge_weight_);
    for (const size_t i : reflectances_) {
      importance = std::max(importance, dweight_dreflectance_[i]);
    }
    if (vertex_ < ThroughputRoulette::kFirstVertex) return importance > 0 || dweight_dalbedo_ > 0;
    const float most = crossings_ > 0 ? 1 : ThroughputRoulette::kMaxSurvival;
    const float probability = std::min(most, importance);
    if (u >= probability) return false;
    weight_ /= probability;
    dweight_dalbedo_ /= probability;
    edge_weight_ /= probability;
    for (const size_t i : reflectances_) dweight_dreflectance_[i] /= probability;
    return true;
  }

  const Scene::Compiled& scene_;
  const RenderRequest& request_;
  const Switches& switches_;
  const Sampler& sampler_;
  const size_t phase_slots_;  // of the object's medium
  const bool stops_at_boundary_;
  const std::optional<size_t> index_slot_;  // of the boundary, for a derivative
  const Geometry& geometry_;

  PathEstimate result_;
  uint32_t vertex_ = 0;
  Interaction at_;
  Vec3f direction_;
  // The medium that the path is in, or whose boundary it met last, and whether that is the
  // object's, in which alone there are scores.
  float sigma_t_ = 1, albedo_ = 0;
  PhaseFunction phase_;
  const Boundary* boundary_ = nullptr;
  bool of_object_ = true;
  // Whether shadow rays look for the light ahead too: not on the camera's ray, nor behind a
  // boundary that is a delta.
  bool use_mis_ = false;
  uint32_t crossings_ = 0;    // of such a boundary, in a row
  uint32_t scatterings_ = 0;  // in the object's medium, so far
  float pdf_ = 0;             // per steradian, with which direction_ was drawn
  float weight_ = 1;
  float dweight_dalbedo_ = 0;  // d weight / d albedo
  float edge_weight_ = 0;      // weight times what edges weigh that were followed
  // d weight / d reflectance, for the derivatives asked for that are in reflectances.
  std::vector<size_t> reflectances_;
  std::array<float, kMaxDerivatives> dweight_dreflectance_{};
  float score_sigma_t_ = 0;  // d log f / d sigma_t, in mm
  Scores score_slots_{};     // d log f / d slot
};

}  // namespace

void trace_reference(const Scene::Compiled& scene, const RenderRequest& request,
                     const Switches& switches, WorkQueue& queue, FilmWriter& film,
                     const std::stop_token& stop) {
  const auto width = static_cast<uint32_t>(scene.film.width);
  std::array<PathSample, 64> samples;
  while (const size_t count = queue.take(samples)) {
    for (const PathSample& sample : std::span(samples).first(count)) {
      const Sampler sampler(request.seed, sample.pixel, sample.sample);
      Walk walk(scene, request, switches, sampler);
      film.add(sample, walk.run(static_cast<int>(sample.pixel % width),
                                static_cast<int>(sample.pixel / width), stop));
    }
  }
}

}  // namespace itn::tracer
