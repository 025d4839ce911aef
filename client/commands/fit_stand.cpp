#include "client/commands/fit_stand.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <span>
#include <utility>

#include "client/fit/disturbances.h"
#include "client/interrupt.h"
#include "client/refine/refine_run.h"
#include "client/refine/refinement.h"
#include "common/error.h"
#include "common/geometry/pose.h"
#include "common/image/photograph.h"

namespace itn {
namespace {

// The standard deviation of g about FitOptions::g where it is not found: nearly all translucent
// materials are within one.
constexpr double kDoubtOfG = 0.4;

// Samples per pixel for an image of `pixels` pixels, so that the sum over these is as noisy as that
// of 96 x 96 pixels with `at_96` samples each; a quarter to 16 times as many as these.
uint32_t spp_for(size_t pixels, uint32_t at_96) {
  constexpr double kUsual = 96 * 96;
  return std::clamp(static_cast<uint32_t>(at_96 * kUsual / static_cast<double>(pixels)), at_96 / 4,
                    16 * at_96);
}

// ---- Renders ---------------------------------------------------------------------------------

// A scene to render, and its material: one for luminance, or three for red, green and blue.
struct Variant {
  v1::Scene scene;
  std::vector<Material> materials;
};

// The radiance by variant, estimate and pixel. Images of colours stand one below the other.
std::vector<std::vector<std::vector<float>>> rendered(std::span<const Variant> variants,
                                                      uint32_t spp, uint32_t estimates,
                                                      uint64_t seed, JobRenderer& pool) {
  std::vector<RenderQuery> queries;
  std::vector<size_t> variant_of;
  for (size_t i = 0; i < variants.size(); ++i) {
    const std::vector<Material>& materials = variants[i].materials;
    v1::Scene scene = variants[i].scene;
    for (size_t c = 0; c < materials.size(); ++c) {
      scene.mutable_film()->set_channel(materials.size() == 1 ? v1::Film::LUMINANCE
                                                              : kColours.at(c));
      queries.push_back({.scene = serialize(scene),
                         .material = materials[c],
                         .spp = spp,
                         .seed = seed,
                         .estimates = estimates});
      variant_of.push_back(i);
    }
  }
  std::vector<std::vector<std::vector<float>>> images(variants.size(),
                                                      std::vector<std::vector<float>>(estimates));
  const std::vector<Render> renders = rendered_by(pool, interruption())(queries);
  for (size_t q = 0; q < renders.size(); ++q) {
    for (size_t e = 0; e < estimates; ++e) {
      const std::vector<float>& radiance = renders[q].estimates[e].radiance;
      std::vector<float>& image = images[variant_of[q]][e];
      image.insert(image.end(), radiance.begin(), radiance.end());
    }
  }
  return images;
}

v1::Scene placed(const Stand& stand, const Mesh& mesh, const FitOptions& options, v1::Scene scene) {
  place(stand, mesh, options, scene);
  return scene;
}

// ---- Disturbances ----------------------------------------------------------------------------

// Pairs of renders, of something more and of less.
struct Changes {
  std::vector<Variant> variants;
  std::vector<RenderedChange> pairs;  // of variants, without their renders

  void add(Variant more, Variant less, double deviations,
           std::vector<std::array<float, 2>> motion = {}) {
    variants.push_back(std::move(more));
    variants.push_back(std::move(less));
    pairs.push_back({.more = {}, .less = {}, .apart = deviations, .motion = std::move(motion)});
  }

  void add_other_g(const v1::Scene& scene, const std::vector<Material>& materials,
                   const FitOptions& options) {
    if (options.g_error > 0) return;  // it is found
    const auto of_g = [&](double g) {
      Variant variant{scene, {}};
      for (const Material& material : materials) {
        variant.materials.push_back(of_similar_light(material, std::clamp(g, -kMaxAbsG, kMaxAbsG)));
      }
      return variant;
    };
    add(of_g(options.g + kDoubtOfG), of_g(options.g - kDoubtOfG), 2);
  }

  // `surface`: planes of what is seen, by pixel (client/fit/disturbances.h).
  Disturbances planes(const std::vector<float>& mask, int width,
                      const std::vector<std::vector<float>>& surface, const FitOptions& options,
                      JobRenderer& pool) const {
    if (variants.empty()) return {};
    constexpr uint32_t kSpp = 128, kEstimates = 4;
    const size_t colours = variants.front().materials.size();
    const auto spp =
        std::max<uint32_t>(kEstimates, spp_for(mask.size(), kSpp) / static_cast<uint32_t>(colours));
    const auto images = rendered(variants, spp, kEstimates, options.refine.settings.seed(), pool);
    std::vector<RenderedChange> changes = pairs;
    for (size_t i = 0; i < changes.size(); ++i) {
      changes[i].more = images[2 * i];
      changes[i].less = images[2 * i + 1];
    }
    Disturbances disturbances;
    const auto pixels = std::ssize(mask);
    for (const std::vector<float>& plane : disturbances_of(changes, mask, width, surface)) {
      std::vector<std::vector<float>>& of_colours = disturbances.emplace_back();
      for (auto first = plane.begin(); first != plane.end(); first += pixels) {
        of_colours.emplace_back(first, first + pixels);
      }
    }
    return disturbances;
  }
};

// Columns of where in the image each pixel is.
std::vector<std::vector<float>> places(size_t pixels, size_t width) {
  std::vector<std::vector<float>> planes(2);
  for (size_t p = 0; p < pixels; ++p) {
    const size_t row = p / width;
    planes[0].push_back(static_cast<float>(p % width));
    planes[1].push_back(static_cast<float>(row));
  }
  return planes;
}

// Columns of where each pixel is, how deep what it shows lies, and how that is turned: means over 4
// x 4 places in it.
std::vector<std::vector<float>> surface_of(const FitPhotograph& photograph, const Mesh& mesh,
                                           const Pose& pose) {
  constexpr int kFine = 4;
  const int side = photograph.side;
  const Silhouette silhouette(mesh, pose, view_of(photograph, kFine * side));
  std::vector<std::vector<float>> planes =
      places(photograph.mask.size(), static_cast<size_t>(side));
  const size_t first = planes.size();
  planes.resize(first + 4);
  for (int y = 0; y < side; ++y) {
    for (int x = 0; x < side; ++x) {
      double depth = 0;
      Vec3d normal{};
      int covered = 0;
      for (int s = 0; s < kFine * kFine; ++s) {
        const int fx = kFine * x + s % kFine, fy = kFine * y + s / kFine;
        if (!silhouette.covers(fx, fy)) continue;
        depth += silhouette.depth(fx, fy);
        normal = normal + silhouette.normal(mesh, fx, fy);
        ++covered;
      }
      const double part = 1.0 / std::max(1, covered);
      const std::array<double, 4> values{depth * part, normal.x * part, normal.y * part,
                                         normal.z * part};
      for (size_t i = 0; i < values.size(); ++i) {
        planes[first + i].push_back(static_cast<float>(values[i]));
      }
    }
  }
  return planes;
}

// How far what is seen moves in the image, from one pose, whose silhouette this is, to another one.
std::vector<std::array<float, 2>> motion_of(const Silhouette& silhouette, const PinholeView& view,
                                            const Pose& from, const Pose& to) {
  std::vector<std::array<float, 2>> motion(static_cast<size_t>(view.side) *
                                           static_cast<size_t>(view.side));
  size_t pixel = 0;
  for (int y = 0; y < view.side; ++y) {
    for (int x = 0; x < view.side; ++x, ++pixel) {
      if (!silhouette.covers(x, y)) continue;
      const Vec3d seen = view.direction(x + 0.5, y + 0.5) * silhouette.depth(x, y);
      const Vec3d moved = to.to_scene(from.to_object(seen));
      motion[pixel] = {static_cast<float>(view.focal * (moved.x / -moved.z - seen.x / -seen.z)),
                       static_cast<float>(-view.focal * (moved.y / -moved.z - seen.y / -seen.z))};
    }
  }
  return motion;
}

// ---- A rough material ------------------------------------------------------------------------

// A few steps of a refinement.
struct Scouting {
  double loss = 0, loss_standard_error = 0;
  Material material;
};

// `mask`: pixels that count.
Scouting scout(const FitPhotograph& photograph, std::vector<float> mask, const Mesh& mesh,
               const Stand& stand, v1::Scene scene, const FitOptions& options,
               v1::Film::Channel channel, const std::vector<Material>& starts,
               const Renderer& renderer) {
  place(stand, mesh, options, scene);
  scene.mutable_film()->set_channel(channel);
  const std::vector<Observation> observations{
      {.name = photograph.name,
       .radiance = radiance_of(photograph.image, photograph.channels, channel),
       .mask = std::move(mask),
       .noise = {},
       .scene = serialize(scene)}};
  v1::RefineSettings settings;
  settings.set_unknown_exposure(true);
  if (card_error_of(options) > 0) {
    (*settings.mutable_known_within())[kExposure] = card_error_of(options);
  }
  settings.add_unknowns(kRoughness);
  settings.set_spp(spp_for(photograph.mask.size(), 32));
  settings.set_max_spp(2 * settings.spp());
  settings.set_max_iterations(8);
  settings.set_seed(options.refine.settings.seed());
  settings = with_defaults(settings);
  Refinement refinement(settings, observations, starts);
  while (!refinement.finished()) refinement.step(renderer);
  const v1::RefineResult result = refinement.result();
  return {result.loss(), result.loss_standard_error(), refinement.material()};
}

struct ScoutedStand {
  size_t pose = 0;  // which
  Stand stand;
  double unlikeness = 0;  // at first sight
  Scouting scouting = {};
};

// ---- The turn of a panorama, and where the sun stands ----------------------------------------

// How unlike the photograph two independent renders are, times the factor that makes them most
// alike: 0 to 1 of the photograph's square, without bias but for the factor.
double unlikeness(std::span<const float> photograph, std::span<const float> mask,
                  const std::vector<std::vector<float>>& renders) {
  double photographed = 0, both = 0, square = 0;
  for (size_t p = 0; p < mask.size(); ++p) {
    if (!is_on_object(mask[p])) continue;
    const double y{photograph[p]}, a{renders[0][p]}, b{renders[1][p]};
    photographed += y * y;
    both += y * (a + b) / 2;
    square += a * b;
  }
  return square > 0 ? 1 - both * both / (photographed * square) : 1;
}

// What is said of how the photograph was taken, and 0 where nothing is.
Stand said_stand(const FitPhotograph& photograph, const Pose& pose, const FitOptions& options) {
  return {pose, photograph.panorama_turn.value_or(0), photograph.camera_down,
          options.sun_elevation.value_or(0)};
}

bool finds_elevation(const FitOptions& options) {
  return is_in_sun(options) && !options.sun_elevation;
}

class LightSearch {
 public:
  // `mask`: pixels that count.
  LightSearch(const FitPhotograph& photograph, std::vector<float> mask, const Mesh& mesh,
              const Pose& pose, const v1::Scene& scene, const FitOptions& options,
              JobRenderer& pool)
      : radiance_(radiance_of(photograph.image, photograph.channels, v1::Film::LUMINANCE)),
        mask_(std::move(mask)),
        mesh_(mesh),
        said_(said_stand(photograph, pose, options)),
        is_turn_said_(photograph.panorama_turn.has_value()),
        scene_(scene),
        options_(options),
        pool_(pool) {}

  struct Found {
    double unlikeness = 0;
    Stand stand;
  };

  // Stands of the light that fit better than those about them, all the way round, with materials of
  // all kinds; at each of some heights of the sun, where that is not known.
  std::vector<Found> stands() const {
    if (!finds_elevation(options_)) return stands_at(said_.sun_elevation);
    std::vector<Found> all;
    for (const double elevation : {20.0, 45.0, 70.0}) {
      const std::vector<Found> found = stands_at(elevation);
      all.insert(all.end(), found.begin(), found.end());
    }
    return all;
  }

  // The best place of the light nearby, for one material.
  Stand improved(Stand stand, const Material& material) const {
    constexpr uint32_t kSpp = 64;
    const auto improve = [&](double Stand::*angle, double step) {
      const auto moved_by = [&](double by) {
        Stand result = stand;
        result.*angle += by;
        return result;
      };
      const std::array<Stand, 3> tried{moved_by(-step), stand, moved_by(step)};
      const std::vector<double> losses = least_losses(tried, {&material, 1}, kSpp);
      stand.*angle += step * vertex(losses[0], losses[1], losses[2]);
    };
    for (const double step : {8.0, 4.0}) {
      if (!is_turn_said_) improve(&Stand::panorama_turn, step);
      if (finds_elevation(options_)) improve(&Stand::sun_elevation, step);
    }
    stand.sun_elevation = std::clamp(stand.sun_elevation, 0.0, 90.0);
    return stand;
  }

 private:
  std::vector<Found> stands_at(double elevation) const {
    constexpr size_t kTurns = 24;
    constexpr double kStep = 360.0 / kTurns;
    const auto at = [&](double turn) {
      Stand stand = said_;
      if (!is_turn_said_) stand.panorama_turn = turn;
      stand.sun_elevation = elevation;
      return stand;
    };
    std::vector<Stand> all;
    for (size_t i = 0; i < (is_turn_said_ ? 1 : kTurns); ++i) {
      all.push_back(at(kStep * static_cast<double>(i)));
    }
    const double per_mm = 1 / longest_side(bounds(mesh_));
    const std::array<Material, 3> kinds{Material{30 * per_mm, 0.9, options_.g},
                                        Material{100 * per_mm, 0.99, options_.g},
                                        Material{300 * per_mm, 0.7, options_.g}};
    constexpr uint32_t kSpp = 6;
    const std::vector<double> losses = least_losses(all, kinds, kSpp);
    if (is_turn_said_) return {{losses.front(), all.front()}};
    const auto smoothed = [&](size_t i) {
      const double before = losses[(i + kTurns - 1) % kTurns], after = losses[(i + 1) % kTurns];
      return 0.25 * before + 0.5 * losses[i % kTurns] + 0.25 * after;
    };
    // The least among two to each side.
    std::vector<Found> minima;
    for (size_t i = kTurns; i < 2 * kTurns; ++i) {
      const double before = smoothed(i - 1), here = smoothed(i), after = smoothed(i + 1);
      if (here > std::min({smoothed(i - 2), before, after, smoothed(i + 2)})) continue;
      minima.push_back(
          {here, at((static_cast<double>(i - kTurns) + vertex(before, here, after)) * kStep)});
    }
    return minima;
  }

  // The place of the least value of a parabola through values at -1, 0 and 1, no further than 1.
  static double vertex(double before, double middle, double after) {
    const double curvature = before - 2 * middle + after;
    if (curvature <= 0) return before < after ? -1 : 1;
    return std::clamp((before - after) / (2 * curvature), -1.0, 1.0);
  }

  // The loss of each stand by the material that is best there.
  std::vector<double> least_losses(std::span<const Stand> stands,
                                   std::span<const Material> materials, uint32_t spp) const {
    constexpr uint32_t kEstimates = 2;
    std::vector<Variant> variants;
    spp = spp_for(mask_.size(), spp);
    for (const Stand& stand : stands) {
      for (const Material& material : materials) {
        variants.push_back({placed(stand, mesh_, options_, scene_), {material}});
      }
    }
    const auto images = rendered(variants, spp, kEstimates, options_.refine.settings.seed(), pool_);
    std::vector<double> losses(stands.size(), std::numeric_limits<double>::infinity());
    for (size_t i = 0; i < images.size(); ++i) {
      double& least = losses[i / materials.size()];
      least = std::min(least, unlikeness(radiance_, mask_, images[i]));
    }
    return losses;
  }

  std::vector<float> radiance_, mask_;
  const Mesh& mesh_;
  const Stand said_;
  const bool is_turn_said_;
  const v1::Scene& scene_;
  const FitOptions& options_;
  JobRenderer& pool_;
};

// ---- The pose --------------------------------------------------------------------------------

std::vector<FoundPose> poses_of(const FitPhotograph& photograph, const Mesh& mesh,
                                const FitOptions& options) {
  std::vector<FoundPose> poses = find_poses(
      mesh, photograph.pose_mask, view_of(photograph, photograph.pose_side), {}, interruption());
  constexpr double kLeastOverlap = 0.9;
  const double best = std::ranges::max(poses, {}, &FoundPose::overlap).overlap;
  if (best < kLeastOverlap) {
    throw invalid_input(fmt::format(
        "{}: wherever the shape stands, its silhouette and the mask overlap by {:.0f} % at most. "
        "Is {} the shape of the object, the focal length right, and the mask of the object alone?",
        photograph.name, 100 * best, options.shape));
  }
  std::erase_if(poses, [&](const FoundPose& one) {
    const std::vector<float> mask = pixels_of_surfaces(photograph, mesh, one.pose);
    return one.overlap < kLeastOverlap || std::ranges::none_of(mask, is_on_object);
  });
  if (poses.empty()) {
    const bool is_bright = std::ranges::count_if(photograph.clipped, is_on_object) > 0;
    throw invalid_input(fmt::format(
        "{}: no pixel shows the object alone, away from its edge and unclipped: it is {}",
        photograph.name, is_bright ? "overexposed; expose less" : "too small or too thin"));
  }
  return poses;
}

}  // namespace

void add_disturbances(const Disturbances& disturbances, Image& image) {
  for (size_t d = 0; d < disturbances.size(); ++d) {
    for (size_t c = 0; c < disturbances[d].size(); ++c) {
      const std::string colour = disturbances[d].size() == 1 ? "" : kRgb.at(c);
      image.channels[disturbance_name(d, colour)] = disturbances[d][c];
    }
  }
}

Material of_similar_light(const Material& material, double g) {
  const double sigma_s = material.sigma_s_reduced() / (1 - g);
  const double sigma_t = sigma_s + material.sigma_a();
  return {std::clamp(sigma_t, kMinRefinedSigmaT, kMaxRefinedSigmaT), sigma_s / sigma_t, g};
}

FoundStand find_stand(const FitPhotograph& photograph, const Mesh& mesh, const v1::Scene& scene,
                      const FitOptions& options, JobRenderer& pool) {
  const Renderer renderer = rendered_by(pool, interruption());
  const bool is_turned =
      !is_by_flash(options) && (!photograph.panorama_turn || finds_elevation(options));
  const std::vector<FoundPose> poses = poses_of(photograph, mesh, options);
  constexpr size_t kMostPoses = 8, kMostStands = 4;
  const size_t tried = std::min(poses.size(), kMostPoses);

  std::vector<ScoutedStand> candidates;
  for (size_t i = 0; i < tried; ++i) {
    const Pose& pose = poses[i].pose;
    if (!is_turned) {
      candidates.push_back({i, said_stand(photograph, pose, options)});
      continue;
    }
    const LightSearch search(photograph, pixels_of_object(photograph, mesh, pose), mesh, pose,
                             scene, options, pool);
    for (const LightSearch::Found& one : search.stands()) {
      candidates.push_back({i, one.stand, one.unlikeness});
    }
  }
  if (is_turned) {
    // At first sight; before the material is known, much is alike.
    constexpr double kFactor = 4, kNoise = 0.01;
    std::ranges::sort(candidates, {}, &ScoutedStand::unlikeness);
    const double most = kFactor * std::max(0.0, candidates.front().unlikeness) + kNoise;
    std::erase_if(candidates, [&](const ScoutedStand& one) { return one.unlikeness > most; });
    candidates.resize(std::min(candidates.size(), kMostStands));
  }
  // Contours within the object tell which pose it is; once that is known, they do not count.
  auto* counted = pixels_of_object;
  const auto scouted = [&](const Stand& stand, uint32_t starts) {
    return scout(photograph, counted(photograph, mesh, stand.pose), mesh, stand, scene, options,
                 v1::Film::LUMINANCE,
                 starts_around(mean_of_size(longest_side(bounds(mesh))), starts), renderer);
  };
  const auto improve_turn = [&](Stand& stand, const Material& material) {
    const LightSearch search(photograph, counted(photograph, mesh, stand.pose), mesh, stand.pose,
                             scene, options, pool);
    stand = search.improved(stand, material);
  };
  if (candidates.size() > 1) {
    for (ScoutedStand& candidate : candidates) {
      candidate.scouting = scouted(candidate.stand, 1);
      if (!is_turned) continue;
      improve_turn(candidate.stand, candidate.scouting.material);
      candidate.scouting = scouted(candidate.stand, 1);
    }
    std::ranges::sort(candidates, {}, [](const ScoutedStand& one) { return one.scouting.loss; });
  }
  const ScoutedStand& best = candidates.front();
  FoundStand found;
  found.pose = poses[best.pose];
  found.stand = best.stand;
  found.alike = poses.size();
  found.ambiguous = poses.size() > tried;
  for (size_t i = 1; i < candidates.size(); ++i) {
    constexpr double kDoubtful = 1.3;
    const Scouting &least = best.scouting, &other = candidates[i].scouting;
    const double noise = 2 * std::hypot(least.loss_standard_error, other.loss_standard_error);
    if (other.loss > kDoubtful * least.loss + noise) continue;
    (candidates[i].pose == best.pose ? found.turn_ambiguous : found.ambiguous) = true;
  }
  counted = pixels_of_surfaces;
  found.material = scouted(found.stand, options.refine.starts).material;
  if (is_turned) {
    improve_turn(found.stand, found.material);
    found.material = scouted(found.stand, 1).material;
    improve_turn(found.stand, found.material);
  }
  if (photograph.channels.size() == 1) {
    found.materials = {found.material};
  } else {
    for (const v1::Film::Channel colour : kColours) {
      found.materials.push_back(scout(photograph, counted(photograph, mesh, found.stand.pose), mesh,
                                      found.stand, scene, options, colour, {found.material},
                                      renderer)
                                    .material);
    }
  }
  return found;
}

Disturbances disturbances_of(const FitPhotograph& photograph, const Mesh& mesh,
                             const FoundStand& found, const v1::Scene& scene,
                             const FitOptions& options, JobRenderer& pool) {
  // So many standard deviations from the middle, that the noise is small beside the difference.
  constexpr double kFar = 2;
  const Pose& pose = found.stand.pose;
  const Vec3d middle = middle_of(bounds(mesh));
  Changes changes;
  // `change`: of a stand, by so many standard deviations.
  const auto add = [&](const auto& change, const std::vector<std::array<float, 2>>& motion) {
    const auto changed = [&](double deviations) {
      Stand stand = found.stand;
      change(stand, deviations);
      return Variant{placed(stand, mesh, options, scene), found.materials};
    };
    changes.add(changed(kFar), changed(-kFar), 2 * kFar, motion);
  };
  const PinholeView view = view_of(photograph, photograph.side);
  const Silhouette silhouette(mesh, pose, view);
  for (const PoseMove& error : found.pose.errors) {
    add([&](Stand& stand, double times) { stand.pose = moved(pose, middle, error, times); },
        motion_of(silhouette, view, pose, moved(pose, middle, error)));
  }
  if (!is_by_flash(options) && options.turn_error > 0) {
    std::vector<double Stand::*> angles{&Stand::panorama_turn, &Stand::camera_down};
    if (is_in_sun(options)) angles.push_back(&Stand::sun_elevation);
    for (double Stand::*const angle : angles) {
      add([&](Stand& stand, double times) { stand.*angle += times * options.turn_error; }, {});
    }
  }
  changes.add_other_g(placed(found.stand, mesh, options, scene), found.materials, options);
  return changes.planes(pixels_of_surfaces(photograph, mesh, pose), photograph.side,
                        surface_of(photograph, mesh, pose), options, pool);
}

Disturbances disturbances_of_g(const v1::Scene& scene, const std::vector<Material>& materials,
                               const std::vector<float>& mask, const FitOptions& options,
                               JobRenderer& pool) {
  Changes changes;
  changes.add_other_g(scene, materials, options);
  return changes.planes(mask, static_cast<int>(scene.film().width()),
                        places(mask.size(), scene.film().width()), options, pool);
}

}  // namespace itn
