#include "client/refine/small_matrix.h"

#include <cmath>
#include <utility>

namespace itn {

SmallMatrix SmallMatrix::of(std::span<const double> values) {
  SmallMatrix matrix(static_cast<size_t>(std::lround(std::sqrt(values.size()))));
  matrix.values_.assign(values.begin(), values.end());
  return matrix;
}

SmallMatrix& SmallMatrix::operator+=(const SmallMatrix& other) {
  for (size_t i = 0; i < values_.size(); ++i) values_[i] += other.values_[i];
  return *this;
}

SmallMatrix& SmallMatrix::operator*=(double factor) {
  for (double& value : values_) value *= factor;
  return *this;
}

SmallMatrix operator*(const SmallMatrix& a, const SmallMatrix& b) {
  SmallMatrix product(a.size());
  for (size_t i = 0; i < a.size(); ++i) {
    for (size_t j = 0; j < a.size(); ++j) {
      for (size_t k = 0; k < a.size(); ++k) product(i, j) += a(i, k) * b(k, j);
    }
  }
  return product;
}

std::vector<double> operator*(const SmallMatrix& a, std::span<const double> b) {
  std::vector<double> product(a.size());
  for (size_t i = 0; i < a.size(); ++i) {
    for (size_t k = 0; k < a.size(); ++k) product[i] += a(i, k) * b[k];
  }
  return product;
}

SmallMatrix transposed(const SmallMatrix& a) {
  SmallMatrix result(a.size());
  for (size_t i = 0; i < a.size(); ++i) {
    for (size_t j = 0; j < a.size(); ++j) result(j, i) = a(i, j);
  }
  return result;
}

SmallMatrix inverse(const SmallMatrix& a) {
  const size_t n = a.size();
  SmallMatrix left = a, right(n);
  for (size_t i = 0; i < n; ++i) right(i, i) = 1;
  for (size_t column = 0; column < n; ++column) {
    size_t pivot = column;
    for (size_t row = column + 1; row < n; ++row) {
      if (std::abs(left(row, column)) > std::abs(left(pivot, column))) pivot = row;
    }
    for (size_t j = 0; j < n; ++j) {
      std::swap(left(pivot, j), left(column, j));
      std::swap(right(pivot, j), right(column, j));
    }
    const double scale = 1 / left(column, column);
    for (size_t j = 0; j < n; ++j) {
      left(column, j) *= scale;
      right(column, j) *= scale;
    }
    for (size_t row = 0; row < n; ++row) {
      const double factor = left(row, column);
      for (size_t j = 0; j < n && row != column; ++j) {
        left(row, j) -= factor * left(column, j);
        right(row, j) -= factor * right(column, j);
      }
    }
  }
  return right;
}

double quadratic_form(const SmallMatrix& a, std::span<const double> x) {
  const std::vector<double> product = a * x;
  double sum = 0;
  for (size_t i = 0; i < x.size(); ++i) sum += x[i] * product[i];
  return sum;
}

SmallMatrix sandwich(const SmallMatrix& a, const SmallMatrix& c) {
  return a * c * transposed(a);
}

}  // namespace itn
