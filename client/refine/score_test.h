// Which materials the images do not contradict.
//
// At a step d to the truth the score s - H d (client/refine/normal_equations.h) has mean 0 and a
// covariance S(d) that the pixels tell, noise of H included, so that
//
//   Q(d) = (s - H d)' S(d)^-1 (s - H d)
//
// is chi-squared. What is far from contradicting that, makes the interval (Anderson and Rubin,
// "Estimation of the parameters of a single equation in a complete system of stochastic equations",
// Annals of Mathematical Statistics 1949; Fieller, "Some problems in interval estimation", JRSS B
// 1954). H^-1 S H^-T would do as well where H is known well. But along the similarity ridge H may
// be hardly more than noise, which once in a while is large by chance, and such a covariance small
// by chance; while Q is hardly changed there, and its interval wide, however H turned out.
#pragma once

#include "client/refine/matrix.h"

namespace itn {

class ScoreTest {
 public:
  // `moments`: of each pixel's part of s and of H, row by row: the sums of their products.
  ScoreTest(Matrix curvature, Vector gradient, Matrix moments);

  Matrix score_covariance(const Vector& step) const;  // S(d)

  Vector full_step() const;   // H^-1 s
  Matrix covariance() const;  // H^-1 S H^-T there

  // The least Q of all steps that go `along` in coordinate kRidge, plus `precision` |d|^2.
  struct Profile {
    double statistic = 0;
    Vector step;        // where
    Matrix covariance;  // of the other coordinates there; 0 in kRidge
  };
  Profile profile(double along, double precision = 0) const;

  double statistic(const Vector& step) const;  // Q(d)

  // -2 ln of the likelihood of a step times the Gaussian of one who expects it about `length` long
  // in every coordinate: Q(d) + ln det S(d) + |d|^2 / length^2. Without the determinant, to go far
  // where H is noise would seem to explain everything.
  double height(const Vector& step, double length) const;
  // About the step of the least height of those as far as about `length` along kRidge.
  Vector best_step(double length) const;

  // logit g: the others are those that an image tells well, whatever it is.
  static constexpr Eigen::Index kRidge = 2;

 private:
  Matrix curvature_;
  Vector gradient_;
  Matrix moments_;
};

}  // namespace itn
