// Whether numbers may be independent and uniform in [0, 1].
#pragma once

#include <vector>

namespace itn {

// The p-value of the Kolmogorov-Smirnov test: the probability that so many independent uniform
// numbers stray as far from their distribution. By the limit for many numbers, with the correction
// for few of Stephens, "Use of the Kolmogorov-Smirnov, Cramer-von Mises and related statistics
// without extensive tables", Journal of the Royal Statistical Society B, 1970. 1 without numbers.
double uniformity_p_value(std::vector<double> numbers);

}  // namespace itn
