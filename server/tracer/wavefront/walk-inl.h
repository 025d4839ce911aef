// Paths in stages: every path of the wavefront flies, then all interact, then all shadow rays
// are traced, and so on. The algorithm is that of reference/path.cpp, where the
// estimators are derived; what is added here to make it quicker or quieter is derived where it
// stands.
#if defined(ITN_TRACER_WAVEFRONT_WALK_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef ITN_TRACER_WAVEFRONT_WALK_INL_H_
#undef ITN_TRACER_WAVEFRONT_WALK_INL_H_
#else
#define ITN_TRACER_WAVEFRONT_WALK_INL_H_
#endif

#include <algorithm>
#include <array>
#include <span>
#include <stop_token>
#include <vector>

#include "common/error.h"
#include "server/tracer/lights/lights-inl.h"
#include "server/tracer/wavefront/lines/follow-inl.h"
#include "server/tracer/wavefront/pixel_sequences-inl.h"
#include "server/tracer/wavefront/wavefront.h"

HWY_BEFORE_NAMESPACE();
namespace itn::tracer::HWY_NAMESPACE {

// Whether derivatives in the medium are asked for; all three are computed then.
inline bool asks_for_medium(const RenderRequest& request) {
  return std::any_of(request.derivatives.begin(), request.derivatives.end(),
                     [](const Parameter& p) { return p.of_medium(); });
}

// The paths under way, a slot each.
struct Walks {
  Rays rays;
  UintColumn pixel{}, sample{}, vertex{};
  UintColumn hit{}, leaked{}, alive{}, steps{};
  // Whether no shadow ray looks for the light ahead too: on the camera's ray, and behind a boundary
  // that bends light. How many of those were crossed in a row.
  UintColumn alone{}, crossings{};
  FloatColumn expected{};                     // radiance, see PathSample
  FloatColumn weight{}, weight_derivative{};  // and d weight / d albedo
  FloatColumn score_sigma_t{}, score_g{};     // d log f / d sigma_t in mm, d log f / dg
  FloatColumn pdf{};                          // per steradian, of the last direction
  FloatColumn u1{}, u2{}, u3{};               // random numbers of the vertex
  FloatColumn first_flight{};                 // the random number of the first flight
  FloatColumn radiance{}, d_sigma_t{}, d_albedo{}, d_g{};  // collected so far
  FloatColumn zero_sigma_t{}, zero_g{};                    // see book_flight and scatter
  std::vector<FloatColumn> weights, radiances;             // for RenderRequest::albedos
  // For the surfaces and lights that derivatives are asked for in.
  std::vector<FloatColumn> weights_by_reflectance, d_reflectances, d_lights;

  // Moves a path to another slot.
  void move(size_t from, size_t to) {
    const auto vectors = {&rays.position, &rays.direction};
    for (VectorColumn* column : vectors) {
      column->set(to, column->at(from));
    }
    for (UintColumn* column : {&rays.interaction, &pixel, &sample, &vertex, &alone, &crossings,
                               &hit, &leaked, &alive, &steps}) {
      (*column)[to] = (*column)[from];
    }
    for (FloatColumn* column :
         {&expected, &weight, &weight_derivative, &score_sigma_t, &score_g, &pdf, &first_flight,
          &radiance, &d_sigma_t, &d_albedo, &d_g, &zero_sigma_t, &zero_g}) {
      (*column)[to] = (*column)[from];
    }
    for (auto* columns :
         {&weights, &radiances, &weights_by_reflectance, &d_reflectances, &d_lights}) {
      for (FloatColumn& column : *columns) {
        column[to] = column[from];
      }
    }
  }
};

// The rays to the light that survived their roulette.
struct ShadowRays {
  Rays rays;
  UintColumn slot{};  // of the walk
  // Light that would arrive undimmed, scattered and weighted: without the walk's weight, and with
  // what the walk is worth following for.
  FloatColumn light{}, worth{};
  FloatColumn score_g{};
  std::vector<FloatColumn> parts;  // of `light`, of the lights that derivatives are asked for in
  size_t count = 0;
};

// Depths::thirds where points are.
HWY_INLINE Floats depth_in_thirds(const Depths& depths, Vectors x) {
  const IntTag di;
  const auto per_edge = static_cast<float>(1 / depths.cells.edge);
  const auto cell = [&](Floats position, double low, int size) {
    const Floats place = hn::Mul(hn::Sub(position, set(static_cast<float>(low))), set(per_edge));
    return hn::ConvertTo(di,
                         hn::Clamp(place, hn::Zero(FloatTag()), set(static_cast<float>(size - 1))));
  };
  const auto [nx, ny, nz] = depths.cells.size;
  const Vec3d& low = depths.cells.low;
  const Ints row = hn::Add(hn::Mul(cell(x.z, low.z, nz), hn::Set(di, ny)), cell(x.y, low.y, ny));
  const Ints index = hn::Add(hn::Mul(row, hn::Set(di, nx)), cell(x.x, low.x, nx));
  const auto* const words = reinterpret_cast<const int32_t*>(depths.thirds.data());
  const Ints word = hn::GatherIndex(di, words, hn::ShiftRight<2>(index));
  const Ints shift = hn::ShiftLeft<3>(hn::And(index, hn::Set(di, 3)));
  return hn::ConvertTo(FloatTag(), hn::And(hn::Shr(word, shift), hn::Set(di, 255)));
}

// How the roulette of walks judges them (Wavefront::survive). The more there is to gain, the
// shorter the paths that are stopped: derivatives depend on longer paths than the image, and thin
// objects on shorter ones than thick. Measured best, in variance times time, on a cube, a thin leaf
// and a figure.
struct WalkRoulette {
  float per_threshold;  // 1 / that below which paths play
  float fall_off;       // of the light with depth, in a third of a cell of the depths

  WalkRoulette(const Scene::Compiled& scene, const RenderRequest& request, const Tuning& tuning) {
    const Vec3f size = scene.obstacles.bounds.max - scene.obstacles.bounds.min;
    const auto& [sigma_t, albedo, g] = request.material;
    const bool derivatives = asks_for_medium(request);
    const bool thin = sigma_t * double{std::max({size.x, size.y, size.z})} < 50;
    const double threshold = tuning.walk_roulette >= 0 ? tuning.walk_roulette
                             : !derivatives            ? 0.35
                             : thin                    ? 0.2
                                                       : 0.25;
    per_threshold = static_cast<float>(1 / std::max(threshold, 1e-20));
    // See Wavefront::light_left.
    const double kappa = sigma_t * std::min(1.0, std::sqrt(3 * (1 - albedo) * (1 - albedo * g)));
    const double part = tuning.depth_roulette >= 0 ? tuning.depth_roulette
                        : !derivatives             ? 0.8
                                                   : 0.5;
    // In media so thick that light falls off within a cell, depths are too coarse to be believed.
    constexpr double kMostByCell = 0.7;
    const double by_cell = part * kappa * scene.obstacles.depths.cells.edge;
    fall_off = static_cast<float>(std::min(by_cell, kMostByCell) / 3);
  }
};

// AtBoundary: IndexMatched or Modelled.
template <typename AtBoundary>
class Wavefront {
 public:
  Wavefront(const Scene::Compiled& scene, const RenderRequest& request,
            const RenderOptions& options, WorkQueue& queue, FilmWriter& film)
      : scene_(scene),
        request_(request),
        switches_(options.switches),
        queue_(queue),
        film_(film),
        sigma_t_(static_cast<float>(request.material.sigma_t)),
        albedo_(static_cast<float>(request.material.albedo)),
        g_(static_cast<float>(request.material.g)),
        medium_derivatives_(asks_for_medium(request)),
        threshold_(static_cast<float>(options.tuning.shadow_ray_roulette * scene.lights.power() /
                                      (4 * std::numbers::pi))),
        walk_roulette_(scene, request, options.tuning),
        at_boundary_of_walks_(options.switches.boundary),
        at_boundary_of_shadow_rays_(options.switches.boundary),
        sequences_(request.seed, request.estimates) {
    walks_.weights.resize(request.albedos.size());
    walks_.radiances.resize(request.albedos.size());
    for (const Parameter& parameter : request.derivatives) {
      if (parameter.kind == Parameter::kReflectance) {
        reflecting_.push_back(scene.obstacles.surfaces.triangles_of(parameter.index));
      } else if (parameter.kind == Parameter::kLightScale) {
        lights_.push_back(parameter.index);
      }
    }
    walks_.weights_by_reflectance.resize(reflecting_.size());
    walks_.d_reflectances.resize(reflecting_.size());
    walks_.d_lights.resize(lights_.size());
    shadow_rays_.parts.resize(lights_.size());
    collect_derivatives();
  }

  void run(const std::stop_token& stop) {
    fill();
    while (count_ > 0) {
      if (stop.stop_requested()) {
        throw Error(ErrorKind::kCancelled, "the render was stopped");
      }
      fly();
      interact();
      trace_shadow_rays();
      survive();
      finish();
    }
  }

 private:
  using Techniques = Switches::Techniques;
  static constexpr float kPi = std::numbers::pi_v<float>;

  Words random(size_t i, Uints vertex, Sampler::Purpose purpose) const {
    return philox(vertex, set(uint32_t{purpose}), load(walks_.sample, i), load(walks_.pixel, i),
                  request_.seed);
  }

  // Free flights of all paths. As flights are memoryless, one path length serves for all the parts
  // of the line that lie inside the medium.
  void fly() {
    const Floats zero = hn::Zero(FloatTag());
    for (size_t i = 0; i < count_; i += lanes()) {
      const Uints vertex = load(walks_.vertex, i);
      const Words words = random(i, vertex, Sampler::kWalk);
      const Floats u0 =
          hn::IfThenElse(is(vertex, 1), load(walks_.first_flight, i), uniform(words.w[0]));
      const Floats depth = hn::Sub(zero, log(hn::Sub(set(1.0F), u0)));
      store(hn::Mul(depth, set(1 / sigma_t_)), walks_.rays.budget, i);
      store(uniform(words.w[1]), walks_.u1, i);
      store(uniform(words.w[2]), walks_.u2, i);
      store(uniform(words.w[3]), walks_.u3, i);
    }
    follow_lines(scene_.obstacles, walks_.rays, count_, Report::kEnds, at_boundary_of_walks_);
  }

  // What happens at the ends of the flights: light is met, or the path is scattered or reflected.
  void interact() {
    shadow_rays_.count = 0;
    for (size_t i = 0; i < count_; i += lanes()) {
      const Mask live = hn::FirstN(FloatTag(), count_ - i);
      const Uints end = hn::And(load(walks_.rays.outcome, i), set(Rays::kEndMask));
      const Mask spent = is(end, Rays::kSpent), surface = is(end, Rays::kSurface);
      book_flight(i, spent);
      if constexpr (AtBoundary::kAsks) {
        multiply_weights(i, load(at_boundary_of_walks_.crossings.transmittance, i));
      }
      const Mask escaped = hn::And(live, is(end, Rays::kEscaped));
      if (!hn::AllFalse(FloatTag(), escaped)) {
        meet_light(i, escaped);
      }
      const Uints one = set(uint32_t{1}), none = hn::Zero(UintTag());
      store(hn::IfThenElse(for_uints(is(end, Rays::kLeaked)), one, none), walks_.leaked, i);
      const Mask goes_on = hn::Or(spent, surface);
      store(hn::IfThenElse(for_uints(goes_on), one, none), walks_.alive, i);
      const Mask vertices = hn::And(live, goes_on);
      if (!hn::AllFalse(FloatTag(), vertices)) {
        scatter(i, vertices, spent);
      }
      if constexpr (AtBoundary::kAsks) {
        for (LineBits bits = bits_of(hn::And(live, is(end, Rays::kCrossing))); bits != 0;
             bits &= bits - 1) {
          cross(i + static_cast<size_t>(std::countr_zero(bits)));
        }
      }
    }
  }

  // The boundary bends a path. Shadow rays end there: behind it, light is the walk's alone.
  void cross(size_t slot) {
    const Crossings& crossings = at_boundary_of_walks_.crossings;
    const bool inside = (walks_.rays.interaction[slot] & Rays::kInside) != 0;
    const Sampler sampler(request_.seed, walks_.pixel[slot], walks_.sample[slot]);
    const BoundarySample sample =
        switches_.boundary->sample({.point = walks_.rays.position.at(slot),
                                    .normal = crossings.normal.at(slot),
                                    .direction = walks_.rays.direction.at(slot),
                                    .triangle = crossings.triangle[slot],
                                    .leaving = inside},
                                   sampler.at(walks_.vertex[slot], Sampler::kBoundary));
    if (++walks_.crossings[slot] > BoundaryModel::kMostCrossings) {
      walks_.leaked[slot] = 1;
      return;
    }
    if (sample.event == BoundarySample::Event::kAbsorbed) {
      return;
    }
    const bool passes = sample.event == BoundarySample::Event::kTransmitted;
    walks_.rays.interaction[slot] = inside != passes ? Rays::kInside : 0;
    walks_.rays.direction.set(slot, sample.direction);
    walks_.alone[slot] = walks_.alive[slot] = 1;
    for (FloatColumn* weight : {&walks_.weight, &walks_.weight_derivative}) {
      (*weight)[slot] *= sample.weight;
    }
    for (auto* columns : {&walks_.weights, &walks_.weights_by_reflectance}) {
      for (FloatColumn& weight : *columns) {
        weight[slot] *= sample.weight;
      }
    }
  }

  // By a factor that no derivative is asked for in.
  void multiply_weights(size_t i, Floats factor) {
    store(hn::Mul(load(walks_.weight, i), factor), walks_.weight, i);
    store(hn::Mul(load(walks_.weight_derivative, i), factor), walks_.weight_derivative, i);
    for (auto* columns : {&walks_.weights, &walks_.weights_by_reflectance}) {
      for (FloatColumn& weight : *columns) {
        store(hn::Mul(load(weight, i), factor), weight, i);
      }
    }
  }

  // The score of a free flight, s = [1/sigma_t if it ended in a scattering] - length inside, has
  // the expectation 0 whatever came before. So has the sum of s W over the flights, W being the
  // weight before each: subtracting any multiple of it from the derivative keeps it unbiased. As
  // the light that a path finds after a flight is about W times what it finds from the camera, the
  // pixel's value is the multiple that takes away most of the noise (a control variate: Williams,
  // "Simple statistical gradient-following algorithms", 1992). Likewise for g, in scatter.
  void book_flight(size_t i, Mask spent) {
    if (medium_derivatives_) {
      const Floats length = load(walks_.rays.in_medium, i);
      const Floats score = hn::Sub(hn::IfThenElseZero(spent, set(1 / sigma_t_)), length);
      store(hn::Add(load(walks_.score_sigma_t, i), score), walks_.score_sigma_t, i);
      store(plus_product(load(walks_.zero_sigma_t, i), score, load(walks_.weight, i)),
            walks_.zero_sigma_t, i);
    }
    const Uints entered =
        hn::And(hn::ShiftRight<Rays::kEnteredBit>(load(walks_.rays.outcome, i)), set(uint32_t{1}));
    store(hn::Add(load(walks_.steps, i), entered), walks_.steps, i);
    const auto first = for_uints(is(load(walks_.vertex, i), 1));
    store(hn::IfThenElse(first, entered, load(walks_.hit, i)), walks_.hit, i);
  }

  // Light that walks meet by themselves, after leaving the scene.
  void meet_light(size_t i, Mask escaped) {
    const Arrival light = arrival(scene_.lights, load(walks_.rays.direction, i));
    const Mask alone = not_zero(load(walks_.alone, i));
    const Floats pdf = load(walks_.pdf, i);
    Floats mis_weight = set(1.0F);
    switch (switches_.techniques) {
      case Techniques::kLightsOnly: mis_weight = hn::Zero(FloatTag()); break;
      case Techniques::kPhaseOnly: break;
      case Techniques::kBoth: mis_weight = hn::Div(pdf, hn::Add(pdf, light.pdf)); break;
    }
    mis_weight = hn::IfThenElse(alone, set(1.0F), mis_weight);
    const Floats radiance = hn::IfThenElseZero(escaped, hn::Mul(light.radiance, mis_weight));
    const auto add = [&](Floats by, FloatColumn& column) {
      store(hn::Add(load(column, i), by), column, i);
    };
    const Floats contribution = hn::Mul(load(walks_.weight, i), radiance);
    add(contribution, walks_.radiance);
    if (medium_derivatives_) {
      add(hn::Mul(contribution, load(walks_.score_sigma_t, i)), walks_.d_sigma_t);
      add(hn::Mul(load(walks_.weight_derivative, i), radiance), walks_.d_albedo);
      add(hn::Mul(contribution, load(walks_.score_g, i)), walks_.d_g);
    }
    for (size_t a = 0; a < walks_.weights.size(); ++a) {
      add(hn::Mul(load(walks_.weights[a], i), radiance), walks_.radiances[a]);
    }
    for (size_t r = 0; r < reflecting_.size(); ++r) {
      add(hn::Mul(load(walks_.weights_by_reflectance[r], i), radiance), walks_.d_reflectances[r]);
    }
    for (size_t l = 0; l < lights_.size(); ++l) {
      const Floats part = radiance_of(scene_.lights, lights_[l], load(walks_.rays.direction, i));
      add(hn::IfThenElseZero(escaped, hn::Mul(hn::Mul(load(walks_.weight, i), part), mis_weight)),
          walks_.d_lights[l]);
    }
  }

  // A scattering in the medium (`spent`) or a diffuse reflection: sends a ray to the light, then
  // draws the next direction.
  void scatter(size_t i, Mask vertices, Mask spent) {
    const FloatTag d;
    const Floats zero = hn::Zero(d), one = set(1.0F);
    const Vectors before = load(walks_.rays.direction, i);
    const bool all_in_medium = hn::AllTrue(d, hn::Or(spent, hn::Not(vertices)));
    Floats factor = set(albedo_);
    Vectors axis = before;
    Ints reflecting = hn::Set(IntTag(), -1);  // triangles
    if (!all_in_medium) {
      const Mask on_surface = hn::AndNot(spent, vertices);
      const Uints triangle = surface_of(load(walks_.rays.interaction, i));
      const Ints at = hn::BitCast(IntTag(), hn::IfThenElseZero(for_uints(on_surface), triangle));
      reflecting = hn::BitCast(
          IntTag(), hn::IfThenElse(for_uints(on_surface), triangle, set(Surfaces::kNone)));
      const Surfaces& surfaces = scene_.obstacles.surfaces;
      factor = hn::IfThenElse(spent, factor, gather(surfaces.reflectances.data(), at));
      const Vectors normal{gather(surfaces.normals.x.data(), at),
                           gather(surfaces.normals.y.data(), at),
                           gather(surfaces.normals.z.data(), at)};
      const Mask flip = hn::Ge(dot(normal, before), zero);
      const Vectors facing = if_then_else(flip, Vectors{zero, zero, zero} - normal, normal);
      axis = if_then_else(spent, before, facing);
    }
    if constexpr (AtBoundary::kAsks) {
      factor = hn::IfThenElse(vertices, factor, one);  // paths at the boundary keep their weight
      store(hn::IfThenZeroElse(for_uints(vertices), load(walks_.crossings, i)), walks_.crossings,
            i);
    }

    // W takes the factor; dW/d albedo takes W too, where the factor is the albedo.
    const Floats old_weight = load(walks_.weight, i);
    const Floats weight = hn::Mul(old_weight, factor);
    const Floats weight_derivative = hn::Add(hn::Mul(load(walks_.weight_derivative, i), factor),
                                             hn::IfThenElseZero(spent, old_weight));
    store(weight, walks_.weight, i);
    store(weight_derivative, walks_.weight_derivative, i);
    for (size_t a = 0; a < walks_.weights.size(); ++a) {
      const Floats other = set(static_cast<float>(request_.albedos[a]));
      store(hn::Mul(load(walks_.weights[a], i), hn::IfThenElse(spent, other, factor)),
            walks_.weights[a], i);
    }

    differentiate_by_reflectance(i, reflecting, old_weight, factor);

    const Floats score_g = load(walks_.score_g, i);
    if (switches_.techniques != Techniques::kPhaseOnly) {
      send_shadow_rays(i, vertices, spent, all_in_medium, axis, score_g);
    }

    // The next direction: Henyey-Greenstein around the last one, or the cosine law around the
    // normal (its pdf is cosine / pi: cosine^2 is uniform).
    const Floats u1 = load(walks_.u1, i);
    Floats cosine = sample_hg(u1, g_);
    Floats sine = hn::Sqrt(hn::Max(zero, hn::Sub(one, hn::Mul(cosine, cosine))));
    const Phase phase = hg_phase(cosine, g_);
    const Floats score = hn::IfThenElseZero(spent, phase.score);
    Floats pdf = phase.value;
    if (!all_in_medium) {
      const Floats diffuse = hn::Sqrt(hn::Sub(one, u1));
      cosine = hn::IfThenElse(spent, cosine, diffuse);
      sine = hn::IfThenElse(spent, sine, hn::Sqrt(u1));
      pdf = hn::IfThenElse(spent, pdf, hn::Mul(diffuse, set(1 / kPi)));
    }
    const SinCos phi = sin_cos_of_turn(load(walks_.u2, i));
    const Vectors direction =
        renormalize(around(axis, hn::Mul(sine, phi.cos), hn::Mul(sine, phi.sin), cosine));
    // Paths that have ended keep their direction: NaN would slow the lanes down.
    store(if_then_else(vertices, direction, before), walks_.rays.direction, i);
    store(pdf, walks_.pdf, i);
    if (medium_derivatives_) {
      store(hn::Add(score_g, score), walks_.score_g, i);
      store(plus_product(load(walks_.zero_g, i), score, weight), walks_.zero_g, i);
    }
    store(hn::IfThenZeroElse(for_uints(vertices), load(walks_.alone, i)), walks_.alone, i);
  }

  // dW/d reflectance takes the factor, and W where the factor is this reflectance.
  void differentiate_by_reflectance(size_t i, Ints triangles, Floats old_weight, Floats factor) {
    for (size_t r = 0; r < reflecting_.size(); ++r) {
      // From `first` on, and before `end`.
      const auto below = [](uint32_t n) { return hn::Set(IntTag(), static_cast<int32_t>(n) - 1); };
      const auto own = hn::AndNot(hn::Gt(triangles, below(reflecting_[r].end)),
                                  hn::Gt(triangles, below(reflecting_[r].first)));
      FloatColumn& derivative = walks_.weights_by_reflectance[r];
      const Floats gain = hn::IfThenElseZero(hn::RebindMask(FloatTag(), own), old_weight);
      store(plus_product(gain, load(derivative, i), factor), derivative, i);
    }
  }

  // Next-event estimation: light along one direction drawn from the lights.
  //
  // Roulette before anything is traced: a shadow ray through optical depth x carries v exp(-x). Let
  // it survive with probability min(1, v exp(-x) / tau), carrying at least tau then: with one
  // uniform number u that means x <= log(v / (u tau)), a limit on the depth that is known
  // beforehand.
  void send_shadow_rays(size_t i, Mask vertices, Mask spent, bool all_in_medium, Vectors axis,
                        Floats score_g) {
    const FloatTag d;
    const Floats zero = hn::Zero(d);
    const Uints vertex = load(walks_.vertex, i);
    const Words words = random(i, vertex, Sampler::kShadowRay);
    const Words more = scene_.lights.has_maps() ? random(i, vertex, Sampler::kMap) : Words{};
    const LightDraw light = sample(scene_.lights, words, more);
    const Floats cosine = dot(axis, light.direction);
    auto [value, score] = hg_phase(cosine, g_);
    if (!all_in_medium) {
      const Floats diffuse = hn::Mul(hn::Max(zero, cosine), set(1 / kPi));
      value = hn::IfThenElse(spent, value, diffuse);
      score = hn::IfThenElseZero(spent, score);
    }
    // The weight of the draw, radiance / pdf, times that of multiple importance sampling,
    // pdf / (pdf + value): `value` is also the pdf with which the walk would go there
    // by itself. Distant lights have no pdf: what they bring is as it is.
    const Floats competing = switches_.techniques == Techniques::kBoth ? value : zero;
    const Floats pdf_sum =
        hn::IfThenElse(hn::Gt(light.pdf, zero), hn::Add(light.pdf, competing), set(1.0F));
    const Floats undimmed = hn::Div(hn::Mul(light.radiance, value), pdf_sum);
    const Floats worth = hn::Mul(worth_following(i), undimmed);
    Floats limit = set(kMaxOpticalDepth);
    Mask sent = hn::And(vertices, hn::Gt(undimmed, zero));
    if (threshold_ > 0) {
      const Floats u = hn::Sub(set(1.0F), fifth_uniform(words));
      limit = hn::Min(limit, log(hn::Div(worth, hn::Mul(u, set(threshold_)))));
      sent = hn::And(sent, hn::And(hn::Gt(worth, zero), hn::Gt(limit, zero)));
    }

    const size_t at = shadow_rays_.count;
    const auto append = [&](Floats v, FloatColumn& column) {
      hn::CompressStore(v, sent, d, column.data() + at);
    };
    const auto append_vectors = [&](Vectors v, VectorColumn& column) {
      append(v.x, column.x);
      append(v.y, column.y);
      append(v.z, column.z);
    };
    const auto append_uints = [&](Uints v, UintColumn& column) {
      hn::CompressStore(v, for_uints(sent), UintTag(), column.data() + at);
    };
    append_vectors(load(walks_.rays.position, i), shadow_rays_.rays.position);
    append_vectors(light.direction, shadow_rays_.rays.direction);
    append_uints(load(walks_.rays.interaction, i), shadow_rays_.rays.interaction);
    append(hn::Mul(limit, set(1 / sigma_t_)), shadow_rays_.rays.budget);
    append(undimmed, shadow_rays_.light);
    append(worth, shadow_rays_.worth);
    if (medium_derivatives_) {
      append(hn::Add(score_g, score), shadow_rays_.score_g);
    }
    for (size_t l = 0; l < lights_.size(); ++l) {
      const Floats part = radiance_of(scene_.lights, lights_[l], words, light);
      append(hn::Div(hn::Mul(part, value), pdf_sum), shadow_rays_.parts[l]);
    }
    append_uints(hn::Add(hn::Iota(UintTag(), 0), set(static_cast<uint32_t>(i))), shadow_rays_.slot);
    shadow_rays_.count += hn::CountTrue(d, sent);
  }

  // Traces the shadow rays, and adds the light that they bring, dimmed by the medium.
  void trace_shadow_rays() {
    follow_lines(scene_.obstacles, shadow_rays_.rays, shadow_rays_.count, Report::kLengths,
                 at_boundary_of_shadow_rays_);
    const FloatTag d;
    for (size_t i = 0; i < shadow_rays_.count; i += lanes()) {
      const Mask live = hn::FirstN(d, shadow_rays_.count - i);
      const Uints end = hn::And(load(shadow_rays_.rays.outcome, i), set(Rays::kEndMask));
      // Lanes beyond the last ray add nothing, in the spare slot.
      const Ints slot =
          hn::BitCast(IntTag(), hn::IfThenElse(for_uints(live), load(shadow_rays_.slot, i),
                                               set(static_cast<uint32_t>(kSlots))));
      const Mask leaked = hn::And(live, is(end, Rays::kLeaked));
      if (!hn::AllFalse(d, leaked)) {
        const Uints before = hn::GatherIndex(UintTag(), walks_.leaked.data(), slot);
        hn::ScatterIndex(hn::IfThenElse(for_uints(leaked), set(uint32_t{1}), before), UintTag(),
                         walks_.leaked.data(), slot);
      }
      const Mask arrived = hn::And(live, is(end, Rays::kEscaped));
      if (hn::AllFalse(d, arrived)) {
        continue;
      }
      const Floats length = load(shadow_rays_.rays.in_medium, i);
      const Floats dimming = exp(hn::Mul(length, set(-sigma_t_)));
      Floats survival = set(1.0F);
      if (threshold_ > 0) {
        survival = hn::Min(
            survival, hn::Mul(hn::Mul(load(shadow_rays_.worth, i), dimming), set(1 / threshold_)));
      }
      const auto arriving = [&](const FloatColumn& undimmed) {
        Floats dimmed = hn::Mul(load(undimmed, i), dimming);
        if constexpr (AtBoundary::kAsks) {
          dimmed = hn::Mul(dimmed, load(at_boundary_of_shadow_rays_.crossings.transmittance, i));
        }
        return hn::IfThenElseZero(arrived, threshold_ > 0 ? hn::Div(dimmed, survival) : dimmed);
      };
      const Floats light = arriving(shadow_rays_.light);
      const auto gathered = [&](const FloatColumn& column) { return gather(column.data(), slot); };
      const auto add = [&](Floats by, FloatColumn& column) {
        hn::ScatterIndex(hn::Add(gathered(column), by), d, column.data(), slot);
      };
      const Floats contribution = hn::Mul(gathered(walks_.weight), light);
      add(contribution, walks_.radiance);
      if (medium_derivatives_) {
        add(hn::Mul(contribution, hn::Sub(gathered(walks_.score_sigma_t), length)),
            walks_.d_sigma_t);
        add(hn::Mul(gathered(walks_.weight_derivative), light), walks_.d_albedo);
        add(hn::Mul(contribution, load(shadow_rays_.score_g, i)), walks_.d_g);
      }
      for (size_t a = 0; a < walks_.weights.size(); ++a) {
        add(hn::Mul(gathered(walks_.weights[a]), light), walks_.radiances[a]);
      }
      for (size_t r = 0; r < reflecting_.size(); ++r) {
        add(hn::Mul(gathered(walks_.weights_by_reflectance[r]), light), walks_.d_reflectances[r]);
      }
      for (size_t l = 0; l < lights_.size(); ++l) {
        add(hn::Mul(gathered(walks_.weight), arriving(shadow_rays_.parts[l])), walks_.d_lights[l]);
      }
    }
  }

  // What a path is worth following for. In thick media of high albedo the derivative comes from
  // long paths, whose W is small but whose dW/d albedo is not; so does the derivative in the
  // reflectance of a dark surface, from paths of a few reflections.
  Floats worth_following(size_t i) const {
    Floats worth = hn::Max(load(walks_.weight, i),
                           hn::Mul(set(kRouletteDerivative), load(walks_.weight_derivative, i)));
    for (const FloatColumn& derivative : walks_.weights_by_reflectance) {
      worth = hn::Max(worth, hn::Mul(set(kRouletteReflectance), load(derivative, i)));
    }
    return worth;
  }

  // How much light is left where the path is, of that below the boundary: it falls off as
  // exp(-kappa z) with the depth z, by diffusion theory with
  //   kappa = sqrt(3 (1 - albedo) (1 - albedo g)) sigma_t,
  // which is too steep where it exceeds sigma_t. As this knows nothing of where the light comes
  // from, nor of paths that bring it back, only a part of it is believed.
  Floats light_left(size_t i) const {
    const Mask inside = not_zero(hn::And(load(walks_.rays.interaction, i), set(Rays::kInside)));
    const Floats thirds = hn::IfThenElseZero(
        inside, depth_in_thirds(scene_.obstacles.depths, load(walks_.rays.position, i)));
    const Floats exponent = hn::Mul(thirds, set(-walk_roulette_.fall_off));
    return exp(hn::Max(exponent, set(kLeastExponent)));
  }

  // Russian roulette: a path that is worth little ends, or goes on for those that ended.
  void survive() {
    const Floats one = set(1.0F);
    for (size_t i = 0; i < count_; i += lanes()) {
      const Floats probability =
          switches_.usual_roulette
              ? usual_survival(i)
              : hn::Min(one, hn::Mul(hn::Mul(worth_following(i), light_left(i)),
                                     set(walk_roulette_.per_threshold)));
      const Mask survives = hn::And(hn::Lt(load(walks_.u3, i), probability),
                                    hn::Not(not_zero(load(walks_.leaked, i))));
      const Floats factor = hn::Div(one, hn::Max(probability, set(1e-30F)));
      multiply_weights(i, factor);
      store(hn::IfThenElseZero(for_uints(survives), load(walks_.alive, i)), walks_.alive, i);
      store(hn::Add(load(walks_.vertex, i), set(uint32_t{1})), walks_.vertex, i);
    }
  }

  Floats usual_survival(size_t i) const {
    const Mask begun =
        hn::RebindMask(FloatTag(), hn::Gt(hn::BitCast(IntTag(), load(walks_.vertex, i)),
                                          hn::Set(IntTag(), int{UsualRoulette::kFirstVertex} - 1)));
    Floats worth = load(walks_.weight, i);
    for (const FloatColumn& derivative : walks_.weights_by_reflectance) {
      worth = hn::Max(worth, load(derivative, i));
    }
    return hn::IfThenElse(begun, hn::Min(set(UsualRoulette::kMostSurvival), worth), set(1.0F));
  }

  // Delivers paths that have ended, and puts new ones in their place; where there are no more, the
  // last path moves there.
  void finish() {
    for (size_t slot = count_; slot-- > 0;) {
      if (walks_.alive[slot] != 0) {
        continue;
      }
      deliver(slot);
      if (begin_path(slot)) {
        continue;
      }
      --count_;
      if (slot != count_) {
        walks_.move(count_, slot);
      }
    }
  }

  void fill() {
    while (count_ < kSlots && begin_path(count_)) {
      ++count_;
    }
  }

  void deliver(size_t slot) {
    estimate_.hit = walks_.hit[slot] != 0;
    estimate_.leaked = walks_.leaked[slot] != 0;
    estimate_.steps = walks_.steps[slot];
    estimate_.radiance = walks_.radiance[slot];
    const float expected = walks_.expected[slot];
    for (size_t i = 0; i < derivatives_.size(); ++i) {
      const auto [collected, control_variate] = derivatives_[i];
      estimate_.derivatives[i] = control_variate != nullptr
                                     ? (*collected)[slot] - expected * (*control_variate)[slot]
                                     : (*collected)[slot];
    }
    for (size_t a = 0; a < walks_.radiances.size(); ++a) {
      estimate_.at_albedos[a] = walks_.radiances[a][slot];
    }
    film_.add({walks_.pixel[slot], walks_.sample[slot], expected}, estimate_);
  }

  // Where a derivative is collected, and its control variate, if it has one.
  struct DerivativeColumns {
    const FloatColumn* collected;
    const FloatColumn* control_variate = nullptr;
  };
  void collect_derivatives() {
    size_t reflectance = 0, light = 0;
    for (const Parameter& parameter : request_.derivatives) {
      switch (parameter.kind) {
        case Parameter::kSigmaT:
          derivatives_.push_back({&walks_.d_sigma_t, &walks_.zero_sigma_t});
          break;
        case Parameter::kAlbedo: derivatives_.push_back({&walks_.d_albedo}); break;
        case Parameter::kG: derivatives_.push_back({&walks_.d_g, &walks_.zero_g}); break;
        case Parameter::kReflectance:
          derivatives_.push_back({&walks_.d_reflectances[reflectance++]});
          break;
        case Parameter::kLightScale: derivatives_.push_back({&walks_.d_lights[light++]}); break;
      }
    }
  }

  // Takes the next samples from the queue, and finds out with which rays their paths begin. False
  // if there are none.
  bool take_samples() {
    next_sample_ = 0;
    sample_count_ = queue_.take(samples_);
    const std::span<const PathSample> taken = std::span(samples_).first(sample_count_);
    if (switches_.stratified) {
      sequences_.draw(taken, film_points_);
    } else {
      for (size_t i = 0; i < sample_count_; ++i) {
        const Uniforms u =
            Sampler(request_.seed, taken[i].pixel, taken[i].sample).at(0, Sampler::kFilm);
        for (size_t k = 0; k < 3; ++k) {
          film_points_[k][i] = u[k];
        }
      }
    }
    const auto width = static_cast<uint32_t>(scene_.film.width);
    for (size_t i = 0; i < sample_count_; ++i) {
      const uint32_t pixel = taken[i].pixel;
      camera_rays_[i] = scene_.camera_ray(pixel % width + double{film_points_[0][i]},
                                          pixel / width + double{film_points_[1][i]});
    }
    return sample_count_ > 0;
  }

  // Puts the next path into a slot, with the camera's ray. False if there is none.
  bool begin_path(size_t slot) {
    if (next_sample_ == sample_count_ && !take_samples()) {
      return false;
    }
    const PathSample& sample = samples_[next_sample_];
    const CameraRay& ray = camera_rays_[next_sample_];
    walks_.first_flight[slot] = film_points_[2][next_sample_];
    ++next_sample_;
    walks_.pixel[slot] = sample.pixel;
    walks_.sample[slot] = sample.sample;
    walks_.expected[slot] = sample.expected;
    walks_.rays.position.set(slot, ray.origin);
    walks_.rays.direction.set(slot, ray.direction);
    walks_.rays.interaction[slot] = scene_.camera_inside ? Rays::kInside : 0;
    walks_.weight[slot] = 1;
    walks_.vertex[slot] = walks_.alone[slot] = walks_.alive[slot] = 1;
    walks_.crossings[slot] = 0;
    walks_.hit[slot] = walks_.leaked[slot] = walks_.steps[slot] = 0;
    for (FloatColumn* column : {&walks_.weight_derivative, &walks_.score_sigma_t, &walks_.score_g,
                                &walks_.pdf, &walks_.radiance, &walks_.d_sigma_t, &walks_.d_albedo,
                                &walks_.d_g, &walks_.zero_sigma_t, &walks_.zero_g}) {
      (*column)[slot] = 0;
    }
    for (FloatColumn& weight : walks_.weights) {
      weight[slot] = 1;
    }
    for (auto* columns : {&walks_.radiances, &walks_.weights_by_reflectance, &walks_.d_reflectances,
                          &walks_.d_lights}) {
      for (FloatColumn& column : *columns) {
        column[slot] = 0;
      }
    }
    return true;
  }

  // A shadow ray through more than this many mean free paths carries less than exp(-50) of its
  // light, which is below the rounding of any sum it could be added to.
  static constexpr float kMaxOpticalDepth = 50;
  static constexpr float kRouletteDerivative = 0.05F, kRouletteReflectance = 0.25F;
  // Survivors of the roulette by depth gain at most exp(4) in weight: more would be fireflies.
  static constexpr float kLeastExponent = -4;

  const Scene::Compiled& scene_;
  const RenderRequest& request_;
  const Switches& switches_;
  WorkQueue& queue_;
  FilmWriter& film_;
  const float sigma_t_, albedo_, g_;
  const bool medium_derivatives_;
  const float threshold_;  // of the shadow rays' roulette, as a radiance; 0: all are traced
  const WalkRoulette walk_roulette_;

  Walks walks_;
  size_t count_ = 0;  // paths under way, in slots 0 .. count_ - 1
  ShadowRays shadow_rays_;
  AtBoundary at_boundary_of_walks_, at_boundary_of_shadow_rays_;
  PathEstimate estimate_;                       // of the path that is delivered
  std::vector<DerivativeColumns> derivatives_;  // in the order of the request
  // The triangles of the surfaces, and the lights, that derivatives are asked for in.
  std::vector<Surfaces::Range> reflecting_;
  std::vector<size_t> lights_;
  // Paths that have not begun, with the random numbers of film position and first flight.
  PixelSequences sequences_;
  std::array<PathSample, PixelSequences::kMost> samples_;
  std::array<CameraRay, PixelSequences::kMost> camera_rays_;
  PixelSequences::Points film_points_;
  size_t sample_count_ = 0, next_sample_ = 0;
};

}  // namespace itn::tracer::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif
