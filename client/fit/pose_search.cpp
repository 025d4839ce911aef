#include "client/fit/pose_search.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "client/geometry/simplified.h"
#include "client/in_parallel.h"
#include "common/error.h"
#include "common/image/photograph.h"

namespace itn {
namespace {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
// A turn, a shift, and the margin by which a mask is too large all around.
using Vector7 = Eigen::Matrix<double, 7, 1>;
using Matrix7 = Eigen::Matrix<double, 7, 7>;

// About a unit axis: its rows are the axes turned back.
Rotation<double> turn(Vec3d axis, double angle) {
  const auto row = [&](Vec3d unit) { return turned_about(unit, axis, -angle); };
  return {row({1, 0, 0}), row({0, 1, 0}), row({0, 0, 1})};
}

Rotation<double> turn(Vec3d by) {
  const double angle = length(by);
  return angle > 0 ? turn(by * (1 / angle), angle) : Rotation<double>{};
}

// That which brings one unit vector to another one on the shortest way.
Rotation<double> turn_from_to(Vec3d from, Vec3d to) {
  const Vec3d axis = cross(from, to);
  const double sine = length(axis);
  if (sine < 1e-12) return {};
  return turn(axis * (1 / sine), std::atan2(sine, dot(from, to)));
}

// Evenly spread over the sphere.
Vec3d fibonacci_direction(size_t i, size_t count) {
  const double z = 1 - (2 * static_cast<double>(i) + 1) / static_cast<double>(count);
  const double angle = std::numbers::pi * (3 - std::sqrt(5.0)) * static_cast<double>(i);
  const double r = std::sqrt(1 - z * z);
  return {r * std::cos(angle), r * std::sin(angle), z};
}

// ---- All views -------------------------------------------------------------------------------

struct Candidate {
  Pose pose;
  double overlap = 0;
};

// Tries poses in an image of few pixels.
class ViewSearch {
 public:
  ViewSearch(const Mesh& mesh, std::vector<float> mask, const PinholeView& view)
      : mesh_(mesh),
        mask_(std::move(mask)),
        view_(view),
        middle_(middle_of(bounds(mesh))),
        size_(longest_side(bounds(mesh))),
        seen_(moments_of(mask_, view.side)) {}

  const SilhouetteMoments& seen() const { return seen_; }

  // The best of those that look at the object from this direction, in its own coordinates.
  Candidate from(Vec3d direction) const {
    const Basis<double> basis(direction);
    const Rotation<double> facing{basis.s, basis.t, direction};
    Vec3d toward = normalize(view_.direction(seen_.x, seen_.y));
    double range = 1.5 * size_ * view_.focal / std::sqrt(seen_.area);
    const SilhouetteMoments as_it_is =
        Silhouette(mesh_, placed(facing, toward, range), view_).moments();
    if (as_it_is.area == 0) return {};
    range *= std::sqrt(as_it_is.area / seen_.area);
    // By their longer axes; and all around where these say little.
    constexpr double kRound = 1.5;
    constexpr int kTurns = 12;
    std::vector<double> turns;
    turns.reserve(2 + kTurns);
    for (int i = 0; i < 2; ++i) {
      turns.push_back(std::numbers::pi * i + seen_.angle - as_it_is.angle);
    }
    if (std::min(seen_.elongation, as_it_is.elongation) < kRound) {
      for (int i = 0; i < kTurns; ++i) turns.push_back(2 * std::numbers::pi * i / kTurns);
    }
    // The best two as they are are moved.
    std::vector<std::pair<double, Rotation<double>>> turned;
    for (const double angle : turns) {
      const Rotation<double> rotation = turn({0, 0, 1}, angle).after(facing);
      turned.emplace_back(Silhouette(mesh_, placed(rotation, toward, range), view_).overlap(mask_),
                          rotation);
    }
    std::ranges::sort(turned, std::greater<>(), [](const auto& one) { return one.first; });
    Candidate best;
    for (size_t i = 0; i < std::min<size_t>(2, turned.size()); ++i) {
      const Candidate candidate = settled(turned[i].second, toward, range);
      if (candidate.overlap > best.overlap) best = candidate;
    }
    return best;
  }

 private:
  // The middle of the mesh along a direction, and turned as if that were the axis of the view.
  Pose placed(const Rotation<double>& rotation, Vec3d toward, double range) const {
    const Rotation<double> all = turn_from_to({0, 0, -1}, toward).after(rotation);
    return {all, toward * range - all(middle_)};
  }

  // Moved until it is as large as what is seen, in its middle.
  Candidate settled(const Rotation<double>& rotation, Vec3d toward, double range) const {
    constexpr int kSteps = 2;
    double x = seen_.x, y = seen_.y;
    Candidate best;
    for (int step = 0; step <= kSteps; ++step) {
      const Pose pose = placed(rotation, toward, range);
      const Silhouette silhouette(mesh_, pose, view_);
      const double overlap = silhouette.overlap(mask_);
      if (overlap > best.overlap) best = {pose, overlap};
      const SilhouetteMoments is = silhouette.moments();
      if (is.area == 0) break;
      x += seen_.x - is.x;
      y += seen_.y - is.y;
      toward = normalize(view_.direction(x, y));
      range *= std::sqrt(is.area / seen_.area);
    }
    return best;
  }

  const Mesh& mesh_;
  const std::vector<float> mask_;
  const PinholeView view_;
  const Vec3d middle_;
  const double size_;
  const SilhouetteMoments seen_;
};

// ---- Contours --------------------------------------------------------------------------------

struct ContourTarget {
  double x, y, normal_x, normal_y;
};

// Places between two pixels where the mask falls through a half, and directions in which it rises.
std::vector<ContourTarget> contour_of(const std::vector<float>& mask, int side) {
  const auto at = [&](int x, int y) {
    return mask[static_cast<size_t>(std::clamp(y, 0, side - 1)) * static_cast<size_t>(side) +
                static_cast<size_t>(std::clamp(x, 0, side - 1))];
  };
  const auto is_on = [&](int x, int y) { return at(x, y) > 0.5F; };
  std::vector<ContourTarget> targets;
  for (int y = 1; y + 1 < side; ++y) {
    for (int x = 1; x + 1 < side; ++x) {
      if (!is_on(x, y)) continue;
      if (is_on(x - 1, y) && is_on(x + 1, y) && is_on(x, y - 1) && is_on(x, y + 1)) continue;
      // The slope of the mask over five pixels.
      double dx = 0, dy = 0;
      for (int j = -2; j <= 2; ++j) {
        for (int i = -2; i <= 2; ++i) {
          dx += i * double{at(x + i, y + j)};
          dy += j * double{at(x + i, y + j)};
        }
      }
      const double slope = std::hypot(dx, dy);
      if (slope == 0) continue;
      for (const auto& [u, v] : kBeside) {
        if (is_on(x + u, y + v)) continue;
        const double here = double{at(x, y)}, there = double{at(x + u, y + v)};
        const double part = (here - 0.5) / (here - there);
        targets.push_back({x + 0.5 + part * u, y + 0.5 + part * v, dx / slope, dy / slope});
      }
    }
  }
  return targets;
}

// Pairs of contour points, each with what is nearest to it of the other contour.
struct Match {
  const ContourPoint* point;
  const ContourTarget* target;
  double weight;
  bool is_of_target;  // one for each target
};

// `weight`: of a point; a target's is 1.
std::vector<Match> matches_of(const std::vector<ContourPoint>& points,
                              const std::vector<ContourTarget>& targets, double weight) {
  const auto distance2 = [](const ContourPoint& p, const ContourTarget& t) {
    return (p.x - t.x) * (p.x - t.x) + (p.y - t.y) * (p.y - t.y);
  };
  std::vector<Match> matches;
  std::vector<double> nearest(targets.size(), std::numeric_limits<double>::infinity());
  std::vector<const ContourPoint*> nearest_point(targets.size(), nullptr);
  for (const ContourPoint& point : points) {
    double least = std::numeric_limits<double>::infinity();
    const ContourTarget* found = nullptr;
    for (size_t t = 0; t < targets.size(); ++t) {
      const double d = distance2(point, targets[t]);
      if (d < least) {
        least = d;
        found = &targets[t];
      }
      if (d < nearest[t]) {
        nearest[t] = d;
        nearest_point[t] = &point;
      }
    }
    if (found != nullptr) matches.push_back({&point, found, weight, false});
  }
  for (size_t t = 0; t < targets.size(); ++t) {
    if (nearest_point[t] != nullptr) matches.push_back({nearest_point[t], &targets[t], 1, true});
  }
  return matches;
}

// One step of Gauss and Newton's method: distances along the mask's normals, those of more than a
// few pixels for less.
struct ContourFit {
  // A place on the mesh whose image is on the contour, and what its distance changes by.
  struct Row {
    Vec3d place;
    double normal_x, normal_y, weight;
    Vector7 weighted;  // the derivative of the distance, times the weight
  };
  Matrix7 normal = Matrix7::Zero();
  Vector7 gradient = Vector7::Zero();
  double squares = 0, weights = 0;
  std::vector<Row> rows;  // by target

  double distance() const { return std::sqrt(squares / std::max(weights, 1e-300)); }
  // How far a point is off, in square pixels. Neighbours are off alike, so of so many one counts.
  // Along an edge a mask may be off by a part of a pixel that a pose takes up, and that no distance
  // shows.
  double variance() const {
    constexpr double kAlikePoints = 5, kUnseen = 0.25;
    return kAlikePoints * (distance() * distance() + kUnseen * kUnseen);
  }
  Matrix7 covariance(double size, double range) const;
};

// The covariance of a step, its shifts over the range, where points are off by themselves; and
// where the object has another shape than the mesh, of this size: places are off as a Gaussian
// process is, alike over a sixth of the size, and by as much as explains the distances that are
// left where the pose has taken up what it can.
Matrix7 ContourFit::covariance(double size, double range) const {
  constexpr double kLeast = 1e-12;
  const double alike = size / 6;
  Vector7 scale;
  scale << 1, 1, 1, range, range, range, 1;
  const Matrix7 scaled = scale.asDiagonal() * normal * scale.asDiagonal();
  const Matrix7 inverse = (scaled + kLeast * scaled.trace() * Matrix7::Identity()).inverse();
  Matrix7 sum = Matrix7::Zero();
  for (const Row& a : rows) {
    Vector7 with = Vector7::Zero();
    for (const Row& b : rows) {
      const Vec3d apart = a.place - b.place;
      const double parallel = a.normal_x * b.normal_x + a.normal_y * b.normal_y;
      with += parallel * std::exp(-dot(apart, apart) / (2 * alike * alike)) * b.weighted;
    }
    sum += a.weighted * with.transpose();
  }
  // Targets stand for the points of both contours.
  double of_rows = 0;
  for (const Row& row : rows) of_rows += row.weight;
  const double part = weights / std::max(of_rows, 1e-300);
  sum = scale.asDiagonal() * sum * scale.asDiagonal();
  sum *= part * part;
  const double left = weights - (inverse * sum).trace();
  const double shape_variance = squares / std::max(left, 0.1 * weights);
  return inverse * variance() + shape_variance * inverse * sum * inverse;
}

// `margin`: of the mask, in pixels, which is 0 within `margin_error`.
ContourFit fit_contour(const Pose& pose, double margin, double margin_error, Vec3d middle,
                       const PinholeView& view, const std::vector<Match>& matches) {
  constexpr double kFar = 3;      // pixels
  constexpr double kBetween = 1;  // from a point to the next one of the same contour
  const Vec3d center = pose.to_scene(middle);
  ContourFit fit;
  for (const auto& [point, target, share, is_of_target] : matches) {
    const Vec3d p = pose.to_scene(point->place), arm = p - center;
    const double depth = -p.z;
    // Derivatives of the image's x and y by the place.
    const Vec3d dx{view.focal / depth, 0, view.focal * p.x / (depth * depth)};
    const Vec3d dy{0, -view.focal / depth, -view.focal * p.y / (depth * depth)};
    const Vec3d along = dx * target->normal_x + dy * target->normal_y;
    const Vec3d by_turn = cross(arm, along);
    const double x = point->x - target->x - margin * target->normal_x;
    const double y = point->y - target->y - margin * target->normal_y;
    const double residual = x * target->normal_x + y * target->normal_y;
    const double along_contour = std::abs(x * target->normal_y - y * target->normal_x);
    const double off = std::hypot(residual, std::max(0.0, along_contour - kBetween));
    const double weight = share * (off > kFar ? kFar / off : 1);
    Vector7 row;
    row << by_turn.x, by_turn.y, by_turn.z, along.x, along.y, along.z, -1;
    fit.normal += weight * row * row.transpose();
    fit.gradient += weight * residual * row;
    fit.squares += weight * off * off;
    fit.weights += weight;
    if (is_of_target)
      fit.rows.push_back({point->place, target->normal_x, target->normal_y, weight, weight * row});
  }
  const double known = fit.variance() / (margin_error * margin_error);
  fit.normal(6, 6) += known;
  fit.gradient[6] += known * margin;
  return fit;
}

// Along the directions that the contour tells nothing of, nothing moves.
Vector7 step_of(const ContourFit& fit, double size, double range) {
  constexpr double kDamping = 1e-4, kLargeMargin = 100;
  Vector7 scale;
  scale << 1, 1, 1, size, size, range, kLargeMargin;  // of what is a large step
  const Matrix7 scaled = scale.asDiagonal() * fit.normal * scale.asDiagonal();
  const Matrix7 damped = scaled + kDamping * scaled.trace() / 7 * Matrix7::Identity();
  return -(scale.asDiagonal() * damped.ldlt().solve(scale.asDiagonal() * fit.gradient));
}

class ContourMatcher {
 public:
  // `margin_error`: how far, in pixels, a mask may be too large or too small all around, as a
  // standard deviation. Without it a thin object would stand too near or too far. `finer`: pixels
  // of the silhouettes in a pixel of the mask, along a side.
  ContourMatcher(const Mesh& mesh, const std::vector<float>& mask, const PinholeView& view,
                 double margin_error, int finer)
      : mesh_(mesh),
        mask_(mask),
        view_(view),
        margin_error_(margin_error),
        finer_(finer),
        middle_(middle_of(bounds(mesh))),
        size_(longest_side(bounds(mesh))),
        targets_(contour_of(mask, view.side)) {}

  FoundPose match(const Pose& start, int steps) const {
    Pose pose = start;
    double margin = 0;
    FoundPose best;
    ContourFit best_fit;
    best.distance = std::numeric_limits<double>::infinity();
    constexpr double kNearer = 0.99;
    constexpr int kPatience = 4;
    for (int step = 0, last_nearer = 0; step <= steps && step <= last_nearer + kPatience; ++step) {
      std::vector<ContourPoint> points =
          Silhouette(mesh_, pose, view_.at_side(finer_ * view_.side)).contour();
      for (ContourPoint& point : points) {
        point.x /= finer_;
        point.y /= finer_;
      }
      const std::vector<Match> matches = matches_of(points, targets_, 1.0 / finer_);
      if (matches.empty()) break;
      const ContourFit fit = fit_contour(pose, margin, margin_error_, middle_, view_, matches);
      const double range = length(pose.to_scene(middle_));
      if (fit.distance() < kNearer * best.distance) last_nearer = step;
      if (fit.distance() < best.distance) {
        best = {pose, 0, fit.distance(), 0, 0, {}};
        best_fit = fit;
      }
      const Vector7 by = step_of(fit, size_, range);
      margin += by[6];
      pose = moved(pose, middle_, {{by[0], by[1], by[2]}, {by[3], by[4], by[5]}});
      if (pose.to_scene(middle_).z > -0.6 * size_) break;  // it would be around the camera
    }
    if (std::isfinite(best.distance)) {
      best.overlap = Silhouette(mesh_, best.pose, view_).overlap(mask_);
      set_errors(best_fit, best);
    }
    return best;
  }

 private:
  void set_errors(const ContourFit& fit, FoundPose& found) const {
    const double range = length(found.pose.to_scene(middle_));
    const Matrix7 all = fit.covariance(size_, range);
    const Matrix6 covariance = all.topLeftCorner<6, 6>();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> turns(covariance.topLeftCorner<3, 3>());
    found.angle_error =
        std::min(180.0, std::sqrt(turns.eigenvalues().maxCoeff()) * 180 / std::numbers::pi);
    found.range_error = std::sqrt(covariance(5, 5));
    // What is not known at all, as the turn of a ball, is not gone along far.
    constexpr double kMostTurn = 0.05, kMostShift = 0.03;  // radians; of the range
    const Eigen::SelfAdjointEigenSolver<Matrix6> axes(covariance);
    for (int i = 0; i < 6; ++i) {
      Eigen::Vector<double, 6> error =
          std::sqrt(std::max(0.0, axes.eigenvalues()[i])) * axes.eigenvectors().col(i);
      error /=
          std::max({1.0, error.head<3>().norm() / kMostTurn, error.tail<3>().norm() / kMostShift});
      error.tail<3>() *= range;
      found.errors.push_back({{error[0], error[1], error[2]}, {error[3], error[4], error[5]}});
    }
  }

  const Mesh& mesh_;
  const std::vector<float>& mask_;
  const PinholeView view_;
  const double margin_error_;
  const int finer_;
  const Vec3d middle_;
  const double size_;
  const std::vector<ContourTarget> targets_;
};

// The first ones of a list that differ from those before by more than an angle.
template <typename Found>
std::vector<Found> distinct(const std::vector<Found>& sorted, double angle, size_t most) {
  std::vector<Found> result;
  for (const Found& found : sorted) {
    if (result.size() == most) break;
    const auto is_near = [&](const Found& other) {
      return angle_between(found.pose.rotation, other.pose.rotation) < angle;
    };
    if (std::ranges::none_of(result, is_near)) result.push_back(found);
  }
  return result;
}

// Keeps the first of poses in which the camera sees the same relief: turns of a symmetric shape
// into itself, and poses that differ in their distance alone.
std::vector<FoundPose> of_different_reliefs(const std::vector<FoundPose>& sorted, const Mesh& mesh,
                                            const PinholeView& view) {
  constexpr double kSame = 0.01;  // of the size
  const double near = kSame * longest_side(bounds(mesh));
  std::vector<FoundPose> result;
  std::vector<Silhouette> seen;
  for (const FoundPose& one : sorted) {
    Silhouette silhouette(mesh, one.pose, view);
    const auto is_same = [&](const Silhouette& other) {
      return silhouette.relief_difference(other) < near;
    };
    if (std::ranges::any_of(seen, is_same)) continue;
    result.push_back(one);
    seen.push_back(std::move(silhouette));
  }
  return result;
}

}  // namespace

Pose moved(const Pose& pose, Vec3d middle, const PoseMove& by, double times) {
  const Rotation<double> rotation = turn(by.turn * times).after(pose.rotation);
  const Vec3d center = pose.to_scene(middle) + by.shift * times;
  return {rotation, center - rotation(middle)};
}

double angle_between(const Rotation<double>& a, const Rotation<double>& b) {
  const double trace = dot(a.x, b.x) + dot(a.y, b.y) + dot(a.z, b.z);
  return std::acos(std::clamp((trace - 1) / 2, -1.0, 1.0));
}

FoundPose matched(const Mesh& mesh, const std::vector<float>& mask, const PinholeView& view,
                  const Pose& start) {
  constexpr int kSteps = 60;
  constexpr double kMarginError = 1;
  constexpr int kFiner = 4;
  return ContourMatcher(mesh, mask, view, kMarginError, kFiner).match(start, kSteps);
}

std::vector<FoundPose> find_poses(const Mesh& mesh, const std::vector<float>& mask,
                                  const PinholeView& view, const PoseSearch& search,
                                  const std::stop_token& stop) {
  constexpr int kCoarseSide = 48;
  std::vector<float> coarse = mask;
  PinholeView coarse_view = view;
  while (coarse_view.side > 2 * kCoarseSide && coarse_view.side % 2 == 0) {
    const int half = coarse_view.side / 2;
    coarse = averaged(coarse, 1, coarse_view.side, {0, 0, coarse_view.side}, half);
    coarse_view = coarse_view.at_side(half);
  }
  constexpr size_t kCoarseTriangles = 1500;
  const Mesh coarse_mesh = simplified(mesh, kCoarseTriangles);
  const ViewSearch views(coarse_mesh, coarse, coarse_view);
  if (views.seen().area == 0) throw invalid_input("the mask shows nothing");
  std::vector<Candidate> candidates(search.views);
  in_parallel(search.views, stop,
              [&](size_t i) { candidates[i] = views.from(fibonacci_direction(i, search.views)); });
  std::erase_if(candidates, [](const Candidate& one) { return one.overlap == 0; });
  std::ranges::sort(candidates, std::greater<>(), &Candidate::overlap);
  if (candidates.empty()) throw invalid_input("the object is nowhere in front of the camera");
  constexpr double kDegree = std::numbers::pi / 180;
  constexpr int kSteps = 12;
  constexpr double kMarginError = 0.5;
  constexpr int kFiner = 1;
  const ContourMatcher matcher(coarse_mesh, coarse, coarse_view, kMarginError, kFiner);
  candidates = distinct(candidates, 8 * kDegree, search.moved);
  std::vector<FoundPose> found(candidates.size());
  in_parallel(candidates.size(), stop,
              [&](size_t i) { found[i] = matcher.match(candidates[i].pose, kSteps); });
  std::ranges::sort(found, {}, &FoundPose::distance);
  found = distinct(found, 2 * kDegree, search.moved);
  // Nearly as near as the nearest, in pixels of the coarse mask.
  const double near = 2 * found.front().distance + 0.3;
  std::erase_if(found, [&](const FoundPose& one) { return one.distance > near; });
  std::vector<FoundPose> result(found.size());
  in_parallel(found.size(), stop,
              [&](size_t i) { result[i] = matched(mesh, mask, view, found[i].pose); });
  std::ranges::sort(result, {}, &FoundPose::distance);
  constexpr double kAlike = 1.3, kSlack = 0.05;
  const double as_good = kAlike * result.front().distance + kSlack;
  std::erase_if(result, [&](const FoundPose& one) { return one.distance > as_good; });
  return of_different_reliefs(distinct(result, kDegree, result.size()), coarse_mesh, coarse_view);
}

}  // namespace itn
