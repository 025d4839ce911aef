// Square matrices of a few rows.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace itn {

class SmallMatrix {
 public:
  explicit SmallMatrix(size_t size = 0) : size_(size), values_(size * size) {}
  // Row by row; as many numbers as a square has.
  static SmallMatrix of(std::span<const double> values);

  size_t size() const { return size_; }
  double& operator()(size_t row, size_t column) { return values_[row * size_ + column]; }
  double operator()(size_t row, size_t column) const { return values_[row * size_ + column]; }
  std::span<const double> values() const { return values_; }

  SmallMatrix& operator+=(const SmallMatrix& other);
  SmallMatrix& operator*=(double factor);

 private:
  size_t size_;
  std::vector<double> values_;
};

SmallMatrix operator*(const SmallMatrix& a, const SmallMatrix& b);
std::vector<double> operator*(const SmallMatrix& a, std::span<const double> b);
SmallMatrix transposed(const SmallMatrix& a);

// By elimination with pivots. A matrix that is singular has an inverse with entries that are not
// finite.
SmallMatrix inverse(const SmallMatrix& a);

// x' A x.
double quadratic_form(const SmallMatrix& a, std::span<const double> x);

// A C A'.
SmallMatrix sandwich(const SmallMatrix& a, const SmallMatrix& c);

}  // namespace itn
