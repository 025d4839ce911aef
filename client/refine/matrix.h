// Vectors and matrices of a row for each coordinate.
#pragma once

#include <Eigen/Dense>

namespace itn {

using Vector = Eigen::VectorXd;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

}  // namespace itn
