// What the pixels of one image say about where its material lies, collected over the iterations.
//
// The answer x solves sum_p Z_p (I_p - T_p(x)) = 0 over the pixels: image I, render T and, for each
// coordinate, an instrument Z_p. Whatever the instruments are, the solution is unbiased as long as
// they do not depend on the noise of I and T (instrumental variables: Reiersol, "Confluence
// analysis by means of instrumental sets of variables", 1945); it is the quietest where Z_p = w_p
// dT_p/dx, w_p the inverse variance of I_p. So each estimate T_k of a render is multiplied with the
// derivatives by the other estimates, and by the renders of iterations before, smoothed over the
// neighbours: instruments that are quiet, and owe nothing to T_k. By Newton's method,
//
//   H step = s,  s = sum_p mean_k Z_pk (I_p - T_pk),  H = sum_p mean_k Z_pk dT_pk/dx',
//
// every product one of independent numbers, so that H and s are unbiased given the instruments.
//
// What is left in s has the covariance S = sum_p s_p s_p', as pixels are independent (White, "A
// heteroskedasticity-consistent covariance matrix estimator", Econometrica 1980): noise of image
// and renders together, of which that of the renders shows in how the estimates differ. The
// answer has the covariance H^-1 S H^-T. Where what a scene leaves out makes neighbours differ
// alike, p are blocks of pixels, which are about independent (Liang and Zeger, "Longitudinal data
// analysis using generalized linear models", Biometrika 1986).
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <span>
#include <utility>
#include <vector>

#include "client/refine/matrix.h"
#include "client/refine/observation.h"
#include "itn/v1/refine.pb.h"

namespace itn {

// The point where a render is made, in coordinates x (client/refine/coordinates.h).
struct Linearization {
  Matrix jacobian;  // square: d what a render has derivatives in / d those of x
  double exposure = 1;
  bool exposure_is_coordinate = false;  // its logarithm, the one behind those
  std::vector<double> disturbances;     // the last of x

  size_t coordinates() const {
    return static_cast<size_t>(jacobian.cols()) + (exposure_is_coordinate ? 1 : 0) +
           disturbances.size();
  }
};

// Sums over the pixels.
struct NormalEquations {
  Matrix curvature;     // H
  Vector gradient;      // s
  Matrix render_noise;  // the part of the covariance of s that is noise of the renders

  explicit NormalEquations(Eigen::Index coordinates = 0)
      : curvature(Matrix::Zero(coordinates, coordinates)),
        gradient(Vector::Zero(coordinates)),
        render_noise(Matrix::Zero(coordinates, coordinates)) {}

  NormalEquations& operator+=(const NormalEquations& terms);
  // Adds terms of fewer coordinates, which are these.
  void add(const NormalEquations& terms, const std::vector<Eigen::Index>& coordinates);
};

// The equations of terms that count `factor` times: a covariance counts its square.
NormalEquations scaled(NormalEquations equations, double factor);

// Whether the differences of images and renders hang together over neighbouring pixels. Sums over
// blocks are told from sums over their quarters: what is independent from quarter to quarter, as is
// noise even where demosaicing or compression make neighbours alike, adds up by its squares; what
// is the same all over a block, as where a shadow is missing, adds up as it is.
struct Structure {
  double of_quarters = 0;  // of the squared sums of differences over their standard errors
  double of_blocks = 0;    // likewise
  double shared = 0;       // of the squares of what is the same all over the blocks
  double of_image = 0;     // of the squared radiance, over the same
  uint32_t blocks = 0;

  Structure& operator+=(const Structure& other);
  // There are enough blocks to tell.
  bool is_known() const { return blocks >= 12 && of_quarters > 0; }
  // 1 for noise; 4 at most.
  double over_noise() const { return of_blocks / of_quarters; }
  // What hangs together, relative to the radiance, root mean square.
  double relative() const;
  // By more than `least`, relative to the radiance, and more than noise would.
  bool is_misfit(double least) const;
};

// By place, how sums of s change where the radiance of a square grows by a part of itself.
struct SquareGrowth {
  Vector scores;
  double x = 0, y = 0, pixels = 0;  // sums over the pixels that count
};
using GrowthBySquare = std::map<std::pair<uint32_t, uint32_t>, SquareGrowth>;

// The covariance of s, where the radiance differs by a part `size` of itself, root mean square,
// that is alike over `length` pixels as a Gaussian process is.
Matrix model_error(const GrowthBySquare& squares, double size, double length);

class ImageEquations {
 public:
  // The observation must outlive it. `block`: in squares of so many pixels a side differences may
  // hang together.
  ImageEquations(const Observation& observation, v1::RefineSettings::Weights weights,
                 uint32_t block = 1);

  // What one render says, by pixel and all in all.
  struct Residuals {
    double samples = 0;                            // per pixel
    std::vector<double> radiance;                  // times the exposure
    std::vector<std::vector<double>> derivatives;  // of that, by coordinate
    std::vector<std::vector<double>> scores;       // by coordinate
    std::vector<std::vector<double>> slopes;       // minus those of scores, row by row as H
    NormalEquations equations;
    // Weighted sum of the squared difference to the image, its variance as far as it is noise of
    // the render, and the weighted energy of the image. Weights are the same in all iterations.
    double squares = 0, squares_variance = 0, energy = 0;
    // The part of that sum that the image's noise explains; 0 if it is not known.
    double noise = 0;
    Structure structure;
  };

  // `plain`: the instruments are the other estimates' derivatives as they are, so that s is minus
  // the gradient of the weighted squared difference over 2. The first render decides which pixels
  // count. Throws Error (invalid input) if the render does not fit, or no pixel sees the object.
  Residuals evaluate(const Render& render, uint32_t spp, const Linearization& at, bool plain);

  // Adds it to what was seen before, `moved` in coordinates from here: the scores of that, as they
  // are here, count `decay` times as much as they did, and what instruments are made of, which
  // need not be exact, `long_decay` times.
  void accumulate(const Residuals& residuals, const Vector& moved, double decay, double long_decay);

  // Finds the pixels that no material explains, as those of dust, text or a seam: patches whose
  // difference to the renders so far is far beyond what that of others is. From now on they count
  // the less the farther they are off (Huber, "Robust estimation of a location parameter", Annals
  // of Mathematical Statistics 1964). None do if that were more than a twentieth: it is the scene
  // that is another one.
  void find_unexplained();
  std::vector<uint32_t> unexplained_pixels() const;  // of the image
  // What the sums of all that was taken have of these pixels, and should not.
  NormalEquations unexplained_terms() const;

  // The row and the column of each square of block x block pixels of which some count.
  const std::vector<std::pair<uint32_t, uint32_t>>& squares() const { return places_; }
  // The terms of s and of H, of all that was taken, each render's times its samples: a row for each
  // square, with the n of s and then the n x n of H, row by row, where n is the number of
  // coordinates.
  Eigen::MatrixXd square_terms() const;

  // How the sums of s change where the radiance grows by a part of itself, by squares of so many
  // pixels a side. `exposure`: its coordinate.
  GrowthBySquare growth(uint32_t side, Eigen::Index exposure) const;

  // By how much more differences to the renders so far scatter over large blocks than they would if
  // squares of block x block pixels were independent; at least 1. 1 where a square is a pixel.
  double dependence() const;

  size_t pixels() const { return pixels_.size(); }  // that count

  // The ratio of the sums of image and render.
  double exposure(const Render& render);

  v1::RefineImageState state() const;
  // Throws Error (invalid input) if it does not fit.
  void restore(const v1::RefineImageState& state, size_t coordinates);

 private:
  // One estimate, on the scale of the image and in the coordinates.
  struct Estimate {
    std::vector<double> radiance;
    std::vector<std::vector<double>> derivatives;
  };
  // `factors`: of what disturbs the image, by pixel.
  Estimate estimate_of(const RenderEstimate& render, const Linearization& at,
                       const std::vector<double>& factors) const;
  // By coordinate, of what was seen before and of the other estimates, which are so large a part of
  // all. `residuals` has the means of all estimates.
  std::vector<std::vector<double>> instruments_of(const Estimate& estimate,
                                                  const Residuals& residuals, double others,
                                                  bool plain) const;
  Structure structure_of(std::span<const double> differences) const;
  // Image less render, on the average of what was taken.
  std::vector<double> differences_so_far() const;
  // In standard deviations of noise, as the fixed weights have it.
  std::vector<double> in_deviations(std::vector<double> differences) const;
  // 1 + the sum of the observation's disturbances, so many of each, by pixel that counts.
  std::vector<double> disturbed(std::span<const double> amounts) const;
  void choose_pixels(std::span<const float> coverage);
  void weigh_pixels();
  double inverse_variance(double radiance) const;
  double robust_weight(size_t i) const { return robust_weights_.empty() ? 1 : robust_weights_[i]; }
  std::vector<std::vector<double>> scores_after(const Vector& step) const;
  std::vector<double> smoothed(const std::vector<double>& values) const;

  const Observation& observation_;
  v1::RefineSettings::Weights weights_;
  uint32_t block_;
  std::vector<uint32_t> pixels_;
  std::vector<Eigen::Index> blocks_;                   // which each pixel is in
  std::vector<std::pair<uint32_t, uint32_t>> places_;  // row and column of each block
  std::vector<std::vector<uint32_t>> neighbours_;      // of each pixel, itself and those around it
  std::vector<double> image_, fixed_weights_, squared_noise_;  // by pixel that counts
  std::vector<double> map_;                                    // of MAP
  std::vector<std::vector<double>> disturbances_;              // each empty where it has none
  double mean_ = 0;                                            // of the image
  double noise_at_mean_ = 0, noise_exponent_ = 0;
  std::vector<double> robust_weights_;  // by pixel that counts; empty: all 1
  double samples_ = 0;
  std::vector<double> radiance_;
  std::vector<std::vector<double>> derivatives_, scores_, slopes_;
};

}  // namespace itn
