#include "server/tracer/film/film_writer.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>

namespace itn::tracer {
namespace {

// Radiance is counted in 2^-60 of a power of two near the lights' mean radiance. A sample may be
// 2^40 times that mean, as when the camera looks into the smallest lamp, and 2^20 of them do not
// overflow 127 bits.
constexpr int kQuantumBits = 60;
constexpr double kMaxQuanta = 0x1p100;

// Squares are counted in 2^-64 of the mean's square, so that dark pixels have a standard error too,
// and cut off at 2^104 quanta, a radiance of 2^20 times the mean.
constexpr int kSquaresQuantumBits = 64;
constexpr double kMaxSquareQuanta = 0x1p104;

// The nearest integer.
Sum rounded(double quanta) {
  return static_cast<Sum>(std::rint(quanta));
}

// Integers add up to the same in any order. Their halves are added apart, as no processor adds more
// than 64 bits at once: the thread that makes the low half overflow carries.
void add_to(Sum& sum, Sum by) {
  using Half [[gnu::may_alias]] = uint64_t;
  static_assert(std::endian::native == std::endian::little);
  auto* const halves = reinterpret_cast<Half*>(&sum);
  const auto low = static_cast<uint64_t>(by);
  const uint64_t before = __atomic_fetch_add(&halves[0], low, __ATOMIC_RELAXED);
  const uint64_t carry = before + low < before ? 1 : 0;
  const uint64_t high = static_cast<uint64_t>(by >> 64) + carry;
  if (high != 0) __atomic_fetch_add(&halves[1], high, __ATOMIC_RELAXED);
}

double power_of_two_near(double x) {
  return std::exp2(std::round(std::log2(x)));
}

// In units of the quantum of radiance. The derivative in sigma_t is of the order of radiance times
// a free path, or times the size of the object where that is shorter; the others of that of
// radiance.
double derivative_unit(const Parameter& parameter, const Scene::Compiled& scene,
                       const Material& material) {
  if (parameter.kind != Parameter::kSigmaT) return 1;
  const Bounds& box = scene.obstacles.bounds;
  const double size = static_cast<double>(length(box.max - box.min));
  return power_of_two_near(std::min(1 / material.sigma_t, size));
}

// Radiance per radiance of the panorama, of order 1, is counted in this.
constexpr double kMapQuantum = 0x1p-60;

void prepare_gradient(const Scene::Compiled& scene, const RenderRequest& request, const Plan& plan,
                      FilmSums& film) {
  const std::vector<float>& weights = request.gradient_weights;
  double largest = 0;
  for (const float w : weights) largest = std::max(largest, std::abs(double{w}));
  uint32_t fewest = ~0U;
  for (const auto& estimate : film.estimates) {
    for (const uint32_t count : estimate.counts) {
      if (count > 0) fewest = std::min(fewest, count);
    }
  }
  film.gradient_unit = largest / fewest;
  size_t map_pixels = 0;
  if (request.gradient_light) {
    const EnvironmentMapTable& map = scene.lights.map_of(*request.gradient_light)->table();
    film.map_quantum = kMapQuantum * map.scale();
    map_pixels = map.pixels();
  }
  for (auto& estimate : film.estimates) {
    std::vector<float>& factors = film.gradient_factors.emplace_back(estimate.counts.size());
    for (const PlannedPixel& p : plan.pixels) {
      const size_t i = film.index_of(p.pixel);
      if (estimate.counts[i] == 0) continue;
      factors[i] =
          static_cast<float>(double{weights[p.pixel]} / largest * fewest / estimate.counts[i]);
    }
    estimate.gradient.resize(request.derivatives.size());
    estimate.map_gradient.resize(map_pixels);
    if (request.gradient_normals) estimate.normal_gradient.resize(9 * scene.object_triangles());
  }
}

}  // namespace

FilmSums empty_film(const Scene::Compiled& scene, const RenderRequest& request, const Plan& plan) {
  FilmSums film;
  const Tile tile = tile_of(scene, request);
  film.width = static_cast<int>(tile.width);
  film.height = static_cast<int>(tile.height);
  film.x = static_cast<int>(tile.x);
  film.y = static_cast<int>(tile.y);
  film.film_width = scene.film.width;
  const double mean = power_of_two_near(scene.lights.power() / (4 * std::numbers::pi));
  film.quantum = std::ldexp(mean, -kQuantumBits);
  film.squares_quantum = std::ldexp(mean * mean, -kSquaresQuantumBits);
  const size_t colours = request.colours.size();
  for (const Parameter& parameter : request.derivatives) {
    film.derivative_quanta.insert(
        film.derivative_quanta.end(), std::max<size_t>(colours, 1),
        film.quantum * derivative_unit(parameter, scene, request.material));
  }
  const auto pixels = static_cast<size_t>(film.width) * static_cast<size_t>(film.height);
  film.squares.resize(pixels);
  film.other_squares.assign(colours, std::vector<Sum>(pixels));
  film.hits.resize(pixels);
  film.estimates.resize(request.estimates);
  for (uint32_t k = 0; k < request.estimates; ++k) {
    auto& estimate = film.estimates[k];
    estimate.counts.resize(pixels);
    for (const PlannedPixel& p : plan.pixels) {
      estimate.counts[film.index_of(p.pixel)] =
          samples_of_estimate(p.sample_count, k, request.estimates);
    }
    estimate.radiance.resize(pixels);
    if (request.gradient_weights.empty()) {
      estimate.derivatives.assign(derivative_count(request), std::vector<Sum>(pixels));
    }
    estimate.other_media.assign(request.albedos.size() + colours, std::vector<Sum>(pixels));
  }
  if (!request.gradient_weights.empty()) prepare_gradient(scene, request, plan, film);
  return film;
}

FilmWriter::FilmWriter(FilmSums& film)
    : film_(&film),
      estimates_(static_cast<uint32_t>(film.estimates.size())),
      is_gradient_(!film.gradient_factors.empty()),
      derivatives_(film.derivative_quanta.size()),
      other_media_(film.estimates[0].other_media.size()),
      other_squares_(film.other_squares.size()),
      per_radiance_(1 / film.quantum),
      per_square_(1 / film.squares_quantum) {
  for (size_t i = 0; i < derivatives_; ++i) per_derivative_[i] = 1 / film.derivative_quanta[i];
  if (is_gradient_) gradients_.resize(estimates_);
}

void FilmWriter::add_to_map(uint32_t pixel, uint32_t sample, size_t map_pixel,
                            double per_radiance) {
  const uint32_t k = sample % estimates_;
  const double part = per_radiance * double{film_->gradient_factors[k][film_->index_of(pixel)]};
  add_to(film_->estimates[k].map_gradient[map_pixel], rounded(part / kMapQuantum));
}

void FilmWriter::add_to_normals(uint32_t pixel, uint32_t sample, uint32_t triangle,
                                const std::array<Vec3d, 3>& by_corner) {
  const uint32_t k = sample % estimates_;
  const double factor{film_->gradient_factors[k][film_->index_of(pixel)]};
  std::array<Sum, 9> parts{};
  auto part = parts.begin();
  for (const Vec3d& v : by_corner) {
    for (const double coordinate : {v.x, v.y, v.z}) {
      const double quanta = coordinate * factor * per_radiance_;
      if (!(std::abs(quanta) < kMaxQuanta)) {  // or NaN
        ++counters.invalid_samples;
        return;
      }
      *part++ = rounded(quanta);
    }
  }
  Sum* sum = &film_->estimates[k].normal_gradient[parts.size() * triangle];
  for (const Sum by : parts) add_to(*sum++, by);
}

void FilmWriter::add(const PathSample& sample, const PathEstimate& path) {
  ++counters.paths;
  counters.steps += path.steps;
  const uint32_t estimate = sample.sample % estimates_;
  PixelSums& sums = collected_[(sample.pixel * estimates_ + estimate) % kCollected];
  if (sums.pixel != sample.pixel || sums.estimate != estimate) {
    flush(sums);
    restart(sums, sample.pixel, estimate);
  }
  sums.hits += path.hit ? 1 : 0;
  if (path.leaked) {
    ++counters.leaks;
  } else if (!collect(path, sums)) {
    ++counters.invalid_samples;
  }
}

void FilmWriter::close() {
  for (PixelSums& sums : collected_) {
    flush(sums);
    sums.pixel = PixelSums::kNone;
  }
  for (size_t k = 0; k < gradients_.size(); ++k) {
    for (size_t i = 0; i < derivatives_; ++i) {
      add_to(film_->estimates[k].gradient[i], gradients_[k][i]);
    }
    gradients_[k] = {};
  }
}

void FilmWriter::restart(PixelSums& sums, uint32_t pixel, uint32_t estimate) const {
  sums.pixel = pixel;
  sums.estimate = estimate;
  sums.hits = sums.radiance = sums.squares = 0;
  std::fill_n(sums.derivatives.begin(), derivatives_, 0);
  std::fill_n(sums.other_media.begin(), other_media_, 0);
  std::fill_n(sums.other_squares.begin(), other_squares_, 0);
}

// Adds a path to sums, unless it is NaN, infinite or beyond their range: the one door for these.
bool FilmWriter::collect(const PathEstimate& path, PixelSums& sums) {
  const double radiance = path.radiance * per_radiance_;
  bool representable = std::abs(radiance) < kMaxQuanta;  // false for NaN
  for (size_t i = 0; i < derivatives_; ++i) {
    representable =
        representable && std::abs(path.derivatives[i] * per_derivative_[i]) < kMaxQuanta;
  }
  for (size_t m = 0; m < other_media_; ++m) {
    representable = representable && std::abs(path.other_media[m] * per_radiance_) < kMaxQuanta;
  }
  if (!representable) return false;
  sums.radiance += rounded(radiance);
  const auto square = [&](double x) {
    return rounded(std::min(x * x * per_square_, kMaxSquareQuanta));
  };
  sums.squares += square(path.radiance);
  if (is_gradient_) {
    const double factor{film_->gradient_factors[sums.estimate][film_->index_of(sums.pixel)]};
    for (size_t i = 0; i < derivatives_; ++i) {
      gradients_[sums.estimate][i] += rounded(factor * path.derivatives[i] * per_derivative_[i]);
    }
  } else {
    for (size_t i = 0; i < derivatives_; ++i) {
      sums.derivatives[i] += rounded(path.derivatives[i] * per_derivative_[i]);
    }
  }
  for (size_t m = 0; m < other_media_; ++m) {
    sums.other_media[m] += rounded(path.other_media[m] * per_radiance_);
  }
  for (size_t m = 0; m < other_squares_; ++m) sums.other_squares[m] += square(path.other_media[m]);
  return true;
}

void FilmWriter::flush(const PixelSums& sums) {
  if (sums.pixel == PixelSums::kNone) return;
  const size_t pixel = film_->index_of(sums.pixel);
  auto& estimate = film_->estimates[sums.estimate];
  add_to(estimate.radiance[pixel], sums.radiance);
  for (size_t i = 0; i < estimate.derivatives.size(); ++i) {
    add_to(estimate.derivatives[i][pixel], sums.derivatives[i]);
  }
  for (size_t m = 0; m < other_media_; ++m) {
    add_to(estimate.other_media[m][pixel], sums.other_media[m]);
  }
  for (size_t m = 0; m < other_squares_; ++m) {
    add_to(film_->other_squares[m][pixel], sums.other_squares[m]);
  }
  add_to(film_->squares[pixel], sums.squares);
  add_to(film_->hits[pixel], sums.hits);
}

}  // namespace itn::tracer
