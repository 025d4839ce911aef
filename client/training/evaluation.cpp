#include "client/training/evaluation.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>
#include <set>
#include <utility>

#include <fmt/format.h>

#include "client/dataset/sampler.h"
#include "client/image/colour_difference.h"
#include "client/image/ms_ssim.h"
#include "client/render/job_renderer.h"
#include "client/render/render_query.h"
#include "client/training/augmentation.h"
#include "client/training/noise_map.h"
#include "client/training/shape_bootstrap.h"
#include "client/training/sphere_colour.h"
#include "client/training/uniformity.h"
#include "common/error.h"
#include "common/random.h"

namespace itn {

namespace {

constexpr size_t kBatch = 32;  // images that are estimated at a time

MaterialCoordinates as_triple(const Material& m) {
  return {m.sigma_t, m.albedo, m.g};
}

void set(const MaterialCoordinates& values, v1::Evaluation::Triple& proto) {
  proto.set_sigma_t(values[0]);
  proto.set_albedo(values[1]);
  proto.set_g(values[2]);
}

double quantile(std::vector<double> values, double probability) {
  const auto at = static_cast<ptrdiff_t>(probability * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return values[static_cast<size_t>(at)];
}

MaterialCoordinates squared_error(const Material& prediction, const Material& truth) {
  MaterialCoordinates squares;
  for (size_t k = 0; k < 3; ++k) {
    squares[k] = std::pow(as_triple(prediction)[k] - as_triple(truth)[k], 2);
  }
  return squares;
}

void add(const MaterialCoordinates& terms, MaterialCoordinates& sum) {
  for (size_t k = 0; k < 3; ++k) sum[k] += terms[k];
}

// The root of the mean of squared errors, by the sums of so many predictions.
MaterialCoordinates root_mean(const MaterialCoordinates& squares, size_t count) {
  MaterialCoordinates roots;
  for (size_t k = 0; k < 3; ++k) roots[k] = std::sqrt(squares[k] / static_cast<double>(count));
  return roots;
}

double root_ratio(double squares, double of_constant) {
  return of_constant > 0 ? std::sqrt(squares / of_constant) : HUGE_VAL;
}

// Sums of squared errors, and of those of the constant predictor.
struct Squares {
  MaterialCoordinates ours{}, constant{};

  void add(const Squares& other) {
    itn::add(other.ours, ours);
    itn::add(other.constant, constant);
  }
  MaterialCoordinates ratio() const {
    MaterialCoordinates result;
    for (size_t k = 0; k < 3; ++k) result[k] = root_ratio(ours[k], constant[k]);
    return result;
  }
};

// The squared errors of each image.
std::vector<Squares> squares_of(std::span<const Material> predictions,
                                const LabelledImages& images) {
  const std::vector<Material> constant = constant_predictions(images);
  std::vector<Squares> squares;
  for (size_t i = 0; i < predictions.size(); ++i) {
    squares.push_back({.ours = squared_error(predictions[i], images.truth[i]),
                       .constant = squared_error(constant[i], images.truth[i])});
  }
  return squares;
}

Squares sum_of(std::span<const Squares> terms) {
  Squares sum;
  for (const Squares& term : terms) sum.add(term);
  return sum;
}

std::vector<Material> materials_of(std::span<const MaterialEstimate> estimates) {
  std::vector<Material> materials;
  for (const MaterialEstimate& estimate : estimates) materials.push_back(estimate.material);
  return materials;
}

// The shape of each channel of each image.
std::vector<std::string> shapes_of(const LabelledImages& images) {
  std::vector<std::string> shapes;
  for (size_t i = 0; i < images.truth.size(); ++i) {
    shapes.push_back(images.items[i / images.channels]->shape());
  }
  return shapes;
}

// An interval over shapes of the ratio of the means of two kinds of terms.
v1::Interval interval_of(const ShapeBootstrap& bootstrap,
                         const std::array<std::vector<double>, 2>& terms,
                         double (*ratio)(double ours, double of_constant)) {
  const Estimate estimate = bootstrap.estimate(
      terms, [ratio](std::span<const double> mean) { return ratio(mean[0], mean[1]); });
  v1::Interval interval;
  interval.set_min(estimate.low);
  interval.set_max(estimate.high);
  return interval;
}

// Root-mean-square errors over the constant predictor's, with intervals.
void set_relative(std::span<const Squares> squares, const ShapeBootstrap& bootstrap,
                  v1::Evaluation::Row& row) {
  set(sum_of(squares).ratio(), *row.mutable_relative());
  v1::Interval* const intervals[] = {row.mutable_relative_sigma_t(), row.mutable_relative_albedo(),
                                     row.mutable_relative_g()};
  for (size_t k = 0; k < 3; ++k) {
    std::array<std::vector<double>, 2> terms;
    for (const Squares& term : squares) {
      terms[0].push_back(term.ours[k]);
      terms[1].push_back(term.constant[k]);
    }
    *intervals[k] = interval_of(bootstrap, terms, root_ratio);
  }
}

// The answer with the smallest expected absolute error in each parameter, if a distribution says
// it.
MaterialCoordinates median_of(const MaterialEstimate& estimate) {
  if (!estimate.posterior) return as_triple(estimate.material);
  const auto& p = estimate.posterior->material.parameters;
  return {p[0].median, p[1].median, p[2].median};
}

// Mean absolute errors over those of the truths' median, with intervals.
void set_relative_absolute(std::span<const MaterialEstimate> estimates,
                           const LabelledImages& images, const ShapeBootstrap& bootstrap,
                           v1::Evaluation::Row& row) {
  v1::Interval* const intervals[] = {row.mutable_relative_absolute_sigma_t(),
                                     row.mutable_relative_absolute_albedo(),
                                     row.mutable_relative_absolute_g()};
  const auto ratio = [](double ours, double of_constant) {
    return of_constant > 0 ? ours / of_constant : HUGE_VAL;
  };
  MaterialCoordinates ratios{};
  for (size_t k = 0; k < 3; ++k) {
    std::vector<double> truths;
    for (const Material& truth : images.truth) truths.push_back(as_triple(truth)[k]);
    const double median = quantile(truths, 0.5);
    std::array<std::vector<double>, 2> terms;
    for (size_t i = 0; i < truths.size(); ++i) {
      terms[0].push_back(std::abs(median_of(estimates[i])[k] - truths[i]));
      terms[1].push_back(std::abs(median - truths[i]));
    }
    const auto sum = [](const std::vector<double>& all) {
      return std::accumulate(all.begin(), all.end(), 0.0);
    };
    ratios[k] = ratio(sum(terms[0]), sum(terms[1]));
    *intervals[k] = interval_of(bootstrap, terms, ratio);
  }
  set(ratios, *row.mutable_relative_absolute());
}

// Errors of what the eye sees of the material.
void set_appearance(std::span<const MaterialEstimate> estimates, const LabelledImages& images,
                    v1::Evaluation::Row& row) {
  double albedo_squares = 0, length_squares = 0;
  for (size_t i = 0; i < estimates.size(); ++i) {
    const std::optional<Posterior>& posterior = estimates[i].posterior;
    const Material &ours = estimates[i].material, &truth = images.truth[i];
    const double albedo = posterior ? posterior->diffuse_albedo.mean : diffuse_albedo(ours);
    const double length = posterior ? posterior->diffusion_length.median : diffusion_length(ours);
    albedo_squares += std::pow(albedo - diffuse_albedo(truth), 2);
    length_squares += std::pow(std::log(length / diffusion_length(truth)), 2);
  }
  const auto count = static_cast<double>(estimates.size());
  row.set_diffuse_albedo(std::sqrt(albedo_squares / count));
  row.set_ln_diffusion_length(std::sqrt(length_squares / count));
}

// Parts of the truths inside of their 90 % intervals.
MaterialCoordinates coverage_of(std::span<const MaterialEstimate> estimates,
                                const LabelledImages& images, std::span<const size_t> items) {
  MaterialCoordinates inside{};
  for (const size_t i : items) {
    const MaterialCoordinates truth = as_triple(images.truth[i]);
    for (size_t k = 0; k < 3; ++k) {
      const ParameterPosterior& p = estimates[i].posterior->material.parameters[k];
      inside[k] += p.low <= truth[k] && truth[k] <= p.high ? 1 : 0;
    }
  }
  for (double& part : inside) part /= static_cast<double>(items.size());
  return inside;
}

void set_third(std::span<const MaterialEstimate> estimates, const LabelledImages& images,
               std::span<const size_t> items, v1::Evaluation::Tercile& third) {
  MaterialCoordinates squares{};
  for (const size_t i : items) add(squared_error(estimates[i].material, images.truth[i]), squares);
  third.mutable_sigma_t()->set_min(images.truth[items.front()].sigma_t);
  third.mutable_sigma_t()->set_max(images.truth[items.back()].sigma_t);
  third.set_items(static_cast<uint32_t>(items.size()));
  set(root_mean(squares, items.size()), *third.mutable_rmse());
  if (estimates[items.front()].posterior) {
    set(coverage_of(estimates, images, items), *third.mutable_coverage());
  }
}

// What the predictor sees of an image, with the noise that it has.
ImageBatch seen(const Predictor& predictor, const LabelledImages& images, size_t number) {
  const std::vector<DatasetImage> channels = read_channels(images, number);
  std::vector<float> interleaved;
  for (size_t p = 0; p < channels.front().radiance.size(); ++p) {
    for (const DatasetImage& channel : channels) interleaved.push_back(channel.radiance[p]);
  }
  ImageBatch image = predictor
                         .seen({.width = images.resolution,
                                .height = images.resolution,
                                .channels = static_cast<int>(channels.size()),
                                .pixels = interleaved,
                                .mask = channels.front().mask})
                         .channels;
  std::vector<torch::Tensor> noise;
  for (const DatasetImage& channel : channels) {
    noise.push_back(
        noise_map(channel, images.resolution, static_cast<int>(predictor.model().resolution())));
  }
  image.noise = torch::cat(noise);
  return image;
}

}  // namespace

std::vector<MaterialEstimate> estimate_all(const Predictor& predictor, const LabelledImages& images,
                                           const v1::Augmentation& change,
                                           const std::stop_token& stop) {
  std::vector<MaterialEstimate> estimates;
  for (size_t first = 0; first < images.items.size(); first += kBatch) {
    if (stop.stop_requested()) throw Error(ErrorKind::kCancelled, "interrupted");
    std::vector<ImageBatch> batch;
    for (size_t i = first; i < std::min(first + kBatch, images.items.size()); ++i) {
      batch.push_back(seen(predictor, images, i));
    }
    const ImageBatch all = augmented(concatenated(batch), change, derive_seed(0, {first}));
    for (MaterialEstimate& estimate : predictor.estimate(all)) {
      estimates.push_back(std::move(estimate));
    }
  }
  return estimates;
}

std::vector<MaterialEstimate> combined(const Predictor& predictor, const LabelledImages& images,
                                       std::span<const MaterialEstimate> estimates) {
  const size_t count = images.items.size(), channels = images.channels;
  const auto is_of_one_object = [&](size_t a, size_t b) {
    return images.items[a]->shape() == images.items[b]->shape() &&
           std::ranges::equal(images.truth_of(a), images.truth_of(b));
  };
  std::vector<MaterialEstimate> result;
  bool is_any = false;
  for (size_t first = 0; first < count;) {
    std::vector<std::vector<MaterialEstimate>> views;
    size_t end = first;
    for (; end < count && is_of_one_object(first, end); ++end) {
      const auto of_image = estimates.subspan(end * channels, channels);
      views.emplace_back(of_image.begin(), of_image.end());
    }
    is_any = is_any || views.size() > 1;
    const std::vector<MaterialEstimate> together = predictor.combined(views);
    for (; first < end; ++first) result.insert(result.end(), together.begin(), together.end());
  }
  if (!is_any) {
    throw invalid_input(
        "no two images of the dataset are of one object; itn dataset --views makes such");
  }
  return result;
}

std::vector<Material> constant_predictions(const LabelledImages& images) {
  Material mean{0, 0, 0};
  const auto count = static_cast<double>(images.truth.size());
  for (const Material& truth : images.truth) {
    mean.sigma_t += truth.sigma_t / count;
    mean.albedo += truth.albedo / count;
    mean.g += truth.g / count;
  }
  return std::vector<Material>(images.truth.size(), mean);
}

void set_errors(std::span<const Material> predictions, const LabelledImages& images,
                v1::Evaluation::Row& row) {
  const auto rmse = [&](const auto& quantity) {
    double squares = 0;
    for (size_t i = 0; i < predictions.size(); ++i) {
      squares += std::pow(quantity(predictions[i]) - quantity(images.truth[i]), 2);
    }
    return std::sqrt(squares / static_cast<double>(predictions.size()));
  };
  row.set_sigma_t(rmse([](const Material& m) { return m.sigma_t; }));
  row.set_albedo(rmse([](const Material& m) { return m.albedo; }));
  row.set_g(rmse([](const Material& m) { return m.g; }));
  row.set_ln_sigma_t(rmse([](const Material& m) { return std::log(m.sigma_t); }));
  row.set_sigma_a(rmse([](const Material& m) { return m.sigma_a(); }));
  row.set_sigma_s(rmse([](const Material& m) { return m.sigma_s(); }));
  row.set_sigma_s_reduced(rmse([](const Material& m) { return m.sigma_s_reduced(); }));
}

MaterialCoordinates relative_errors(std::span<const Material> predictions,
                                    const LabelledImages& images) {
  return sum_of(squares_of(predictions, images)).ratio();
}

void set_details(std::span<const MaterialEstimate> estimates, const LabelledImages& images,
                 v1::Evaluation::Row& row) {
  const std::vector<Squares> squares = squares_of(materials_of(estimates), images);
  std::vector<double> sigma_t_errors, reduced_errors;
  for (size_t i = 0; i < estimates.size(); ++i) {
    const Material &ours = estimates[i].material, &truth = images.truth[i];
    const double reduced = estimates[i].posterior
                               ? estimates[i].posterior->scattering.parameters[2].mean
                               : ours.sigma_s_reduced();
    sigma_t_errors.push_back(std::abs(ours.sigma_t / truth.sigma_t - 1));
    reduced_errors.push_back(std::abs(reduced / truth.sigma_s_reduced() - 1));
  }
  const ShapeBootstrap bootstrap(shapes_of(images));
  set_relative(squares, bootstrap, row);
  set_relative_absolute(estimates, images, bootstrap, row);
  set_appearance(estimates, images, row);
  row.set_median_relative_sigma_t(quantile(sigma_t_errors, 0.5));
  row.set_median_relative_sigma_s_reduced(quantile(reduced_errors, 0.5));
  // Thirds in sigma_t.
  std::vector<size_t> order(estimates.size());
  std::iota(order.begin(), order.end(), size_t{0});
  if (estimates.front().posterior) {
    set(coverage_of(estimates, images, order), *row.mutable_coverage());
  }
  std::ranges::stable_sort(
      order, [&](size_t a, size_t b) { return images.truth[a].sigma_t < images.truth[b].sigma_t; });
  for (size_t third = 0; third < 3 && order.size() >= 3; ++third) {
    const size_t begin = third * order.size() / 3, end = (third + 1) * order.size() / 3;
    set_third(estimates, images, std::span(order).subspan(begin, end - begin), *row.add_terciles());
  }
}

namespace {

// In the order of an answer's coordinates.
std::vector<std::string> names_of_coordinates(size_t channels) {
  std::vector<std::string> names;
  for (const char* quantity : {"reduced sigma_t", "reduced albedo"}) {
    for (size_t c = 0; c < channels; ++c) {
      names.push_back(channels > 1 ? fmt::format("{} of {}", quantity, kColourChannels.at(c))
                                   : quantity);
    }
  }
  names.emplace_back("g");
  return names;
}

}  // namespace

void set_likelihood(const Predictor& predictor, std::span<const MaterialEstimate> estimates,
                    const LabelledImages& images, v1::Evaluation::Row& row) {
  if (predictor.model().output() != v1::GAUSSIAN || predictor.channels() != images.channels) return;
  const auto count = static_cast<int64_t>(images.items.size());
  const auto n = static_cast<int64_t>(coordinate_count(images.channels));
  constexpr double kRegion = 0.9;
  double sum = 0;
  uint32_t inside = 0;
  std::set<std::string> shapes;
  std::vector<std::vector<double>> ranks(static_cast<size_t>(n) + 1);  // of one image of each shape
  torch::Tensor truths = torch::empty({count, n}, torch::kFloat64);
  for (int64_t i = 0; i < count; ++i) {
    const auto item = static_cast<size_t>(i);
    const std::span<const Material> truth = images.truth_of(item);
    const MaterialEstimate& estimate = estimates[item * images.channels];
    sum += predictor.log_likelihood(estimate, truth);
    const double region = predictor.region_probability(estimate, truth);
    inside += region <= kRegion ? 1 : 0;
    if (shapes.insert(images.items[item]->shape()).second) {
      std::vector<double> of_image = predictor.marginal_probability(estimate, truth);
      of_image.push_back(region);
      for (size_t k = 0; k < ranks.size(); ++k) ranks[k].push_back(of_image[k]);
    }
    std::ranges::copy(predictor.standardized(truth), truths[i].data_ptr<double>());
  }
  row.set_log_likelihood(sum / static_cast<double>(count));
  row.set_joint_coverage(static_cast<double>(inside) / static_cast<double>(count));
  const std::vector<std::string> names = names_of_coordinates(images.channels);
  for (size_t k = 0; k < ranks.size(); ++k) {
    v1::Evaluation::RankTest& test = *row.add_rank_tests();
    test.set_quantity(k < names.size() ? names[k] : "all together");
    test.set_p_value(uniformity_p_value(std::move(ranks[k])));
  }
  // The mean log-density of points under the Gaussian that fits them best.
  const torch::Tensor d = truths - truths.mean(0);
  const torch::Tensor covariance = d.t().matmul(d) / static_cast<double>(count);
  const auto dimensions = static_cast<double>(n);
  const double log_determinant = torch::linalg_det(covariance).log().item<double>();
  // All media are gray, or of one g, or they are so few that a Gaussian goes through all.
  if (count <= n || !std::isfinite(log_determinant)) return;
  row.set_constant_log_likelihood(
      -0.5 * (dimensions * (std::log(2 * std::numbers::pi) + 1) + log_determinant));
}

void set_outlier_fraction(std::span<const MaterialEstimate> estimates, v1::Evaluation::Row& row) {
  if (!estimates.front().outlier) return;
  const auto count = std::ranges::count_if(
      estimates, [](const MaterialEstimate& e) { return e.outlier->is_outlier; });
  row.set_outlier_fraction(static_cast<double>(count) / static_cast<double>(estimates.size()));
}

double outlier_area(std::span<const MaterialEstimate> usual,
                    std::span<const MaterialEstimate> others) {
  std::vector<double> scores;
  for (const MaterialEstimate& estimate : usual) scores.push_back(estimate.outlier->score);
  std::ranges::sort(scores);
  double higher = 0;
  for (const MaterialEstimate& estimate : others) {
    const auto [first, last] = std::ranges::equal_range(scores, estimate.outlier->score);
    higher += static_cast<double>(first - scores.begin()) + 0.5 * static_cast<double>(last - first);
  }
  return higher / (static_cast<double>(scores.size()) * static_cast<double>(others.size()));
}

std::vector<uint32_t> spread(size_t count, size_t total) {
  const size_t stretches = std::min(count, total);
  std::vector<uint32_t> chosen;
  for (size_t i = 0; i < stretches; ++i) {
    const size_t begin = i * total / stretches, end = (i + 1) * total / stretches;
    chosen.push_back(static_cast<uint32_t>(begin + derive_seed(0, {i}) % (end - begin)));
  }
  return chosen;
}

std::vector<float> rerender(DatasetReader& dataset, JobRenderer& pool, const v1::DatasetItem& item,
                            const Material& material, uint32_t spp, std::stop_token stop,
                            size_t colour) {
  const bool in_colour = item.channel() == v1::Film::RGB;
  const auto shown = static_cast<v1::Film::Channel>(v1::Film::RED + colour);
  std::future<v1::RenderGradReply> future =
      pool.submit(job_of({.scene = dataset.scene(item, in_colour ? shown : item.channel()),
                          .material = material,
                          .spp = spp,
                          // Not the random numbers of the image that it is compared with.
                          .seed = derive_seed(item.seed(), {1})}));
  std::vector<float> image = render_of(wait_for_render(future, stop)).estimates.front().radiance;
  if (in_colour) {  // as LabelledImages::read_colours
    const auto white = static_cast<float>(dataset.white(item).at(colour));
    for (float& value : image) value /= white;
  }
  return image;
}

ImageErrors image_errors(DatasetReader& dataset, JobRenderer& pool, const LabelledImages& images,
                         std::span<const uint32_t> chosen, std::span<const Material> predictions,
                         uint32_t spp, const std::function<void()>& progress,
                         std::stop_token stop) {
  ImageErrors errors;
  const auto count = static_cast<double>(chosen.size() * images.channels);
  for (const uint32_t i : chosen) {
    const std::vector<DatasetImage> channels = read_channels(images, i);
    for (size_t c = 0; c < channels.size(); ++c) {
      const DatasetImage& image = channels[c];
      const std::vector<float> rendered = rerender(
          dataset, pool, *images.items[i], predictions[i * images.channels + c], spp, stop, c);
      errors.relative += relative_image_error(image.radiance, rendered, image.mask) / count;
      const bool black =
          std::ranges::all_of(image.radiance, [](float value) { return value <= 0; });
      if (black) continue;
      errors.dissimilarity += (1 - ms_ssim(images.resolution, image.radiance, rendered)) / count;
    }
    progress();
  }
  return errors;
}

std::vector<std::array<double, 3>> sphere_colours(JobRenderer& pool, const LabelledImages& images,
                                                  std::span<const uint32_t> chosen,
                                                  std::span<const Material> materials, uint32_t spp,
                                                  const std::function<void()>& progress,
                                                  std::stop_token stop) {
  std::vector<std::array<double, 3>> colours;
  for (const uint32_t i : chosen) {
    const v1::DatasetItem& item = *images.items[i];
    colours.push_back(
        sphere_colour(pool, materials.subspan(i * images.channels, images.channels),
                      item.has_boundary() ? std::optional(item.boundary()) : std::nullopt, spp,
                      item.seed(), stop));
    progress();
  }
  return colours;
}

void set_colour_differences(std::span<const std::array<double, 3>> answers,
                            std::span<const std::array<double, 3>> truth,
                            v1::Evaluation::Row& row) {
  std::vector<double> differences;
  for (size_t i = 0; i < answers.size(); ++i) {
    differences.push_back(colour_difference(answers[i], truth[i]));
  }
  if (differences.empty()) return;
  row.set_colour_difference(quantile(differences, 0.5));
  row.set_colour_difference_of_nine_in_ten(quantile(differences, 0.9));
}

double relative_image_error(std::span<const float> image, std::span<const float> rendered,
                            std::span<const float> mask) {
  double error = 0, energy = 0;
  for (size_t p = 0; p < image.size(); ++p) {
    const double difference = static_cast<double>(rendered[p]) - image[p];
    error += mask[p] * difference * difference;
    energy += static_cast<double>(mask[p]) * image[p] * image[p];
  }
  return energy > 0 ? std::sqrt(error / energy) : 0;
}

}  // namespace itn
