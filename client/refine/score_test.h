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

#include <vector>

#include "client/refine/matrix.h"

namespace itn {

// What images that depend on n of the coordinates say of S: sums over squares of pixels, whose
// terms are the n of s and then the n x n of H, row by row, of the products of all pairs of these.
struct ScoreMoments {
  std::vector<Eigen::Index> coordinates;
  Matrix sums;
};

// What is known of the step to the truth, apart from the images: how long it is in a coordinate,
// and how well that is known. Q has the square of what a step is off, over the deviation, too.
struct KnownStep {
  Eigen::Index coordinate = 0;
  double length = 0, deviation = 1;
};

// s and H, and what S is made of.
struct ScoreEquations {
  Vector gradient;                    // s
  Matrix curvature;                   // H
  std::vector<ScoreMoments> moments;  // of the images
  Matrix apart;                       // the covariance of what s has from elsewhere; empty: none
  std::vector<KnownStep> known = {};
  // The coordinate that images may hardly tell, whatever the others are: logit g of one colour or,
  // where g is given, ln sigma_t.
  Eigen::Index ridge = 2;
};

class ScoreTest {
 public:
  explicit ScoreTest(ScoreEquations equations);

  Matrix score_covariance(const Vector& step) const;  // S(d)

  Vector full_step() const;   // H^-1 s, if nothing else is known
  Matrix covariance() const;  // H^-1 S H^-T there, likewise
  // The part of that which an S has that is part of this one, of a test without what is known.
  Matrix covariance_of(const ScoreTest& part) const;

  // The least Q of all steps that go `along` the ridge, plus `precision` |d|^2.
  struct Profile {
    double statistic = 0;
    Vector step;        // where
    Matrix covariance;  // of the other coordinates there; 0 in that of the ridge
  };
  Profile profile(double along, double precision = 0) const;

  double statistic(const Vector& step) const;  // Q(d)

  // -2 ln of the likelihood of a step times the Gaussian of one who expects it about `length` long
  // in every coordinate: Q(d) + ln det S(d) + |d|^2 / length^2. Without the determinant, to go far
  // where H is noise would seem to explain everything.
  double height(const Vector& step, double length) const;
  // About the step of the least height of those as far as about `length` along the ridge.
  Vector best_step(double length) const;

  Eigen::Index ridge() const { return equations_.ridge; }

 private:
  // By least squares, where the scores have this covariance.
  struct Solution {
    Matrix gain;  // d step / d s
    Matrix covariance;
    Vector step;
  };
  Solution solved(const Matrix& score_covariance) const;

  ScoreEquations equations_;
};

}  // namespace itn
