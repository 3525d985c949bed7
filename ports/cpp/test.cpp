// Test of flip_triangles.hpp: `cmake -B build && cmake --build build && ctest --test-dir build`.

#include <array>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "flip_triangles.hpp"

namespace {

using flip_triangles::Order;

int failures = 0;

void expect(bool holds, const std::string& message) {
    if (holds) return;
    failures++;
    std::fprintf(stderr, "failed: %s\n", message.c_str());
}

template <class Number>
std::vector<Number> parse(const std::string& line) {
    std::istringstream stream(line);
    std::vector<Number> values;
    // std::stod reads the numbers written by Python exactly.
    for (std::string token; stream >> token;) values.push_back(static_cast<Number>(std::stod(token)));
    return values;
}

template <class Index>
bool throws(std::vector<Index> triangles) {
    const std::array<double, 8> square = {0, 0, 9, 0, 9, 1, 0, 1};
    const auto before = triangles;
    try {
        flip_triangles::flip(triangles.data(), triangles.size(), square.data(), std::size_t(4));
    } catch (const std::out_of_range&) {
        return triangles == before;
    }
    return false;
}

// Compare with the triangles from Python in vectors.txt, written by tests/ports/vectors.py.
int compare(std::istream& file) {
    int polygons = 0;
    flip_triangles::Flipper flipper;
    for (std::string points, triangles, name, result; std::getline(file, points); polygons++) {
        std::getline(file, triangles);
        const auto xy = parse<double>(points);
        for (int test = 0; test < 5; test++) {
            std::getline(file, name);
            std::getline(file, result);
            const auto by = static_cast<flip_triangles::By>(test);
            auto indices = parse<std::uint32_t>(triangles);
            std::size_t flips = 0;
            if (test == 4)
                flipper.reorder(indices.data(), indices.size(), xy.size() / 2);
            else
                flips = flipper(indices.data(), indices.size(), xy.data(), xy.size() / 2, by, 2, Order::walk, 3.7);
            const std::string label = "polygon " + std::to_string(polygons) + ", " + name;
            expect(indices == parse<std::uint32_t>(result), label);
            expect(name.substr(name.find(' ') + 1) == std::to_string(flips), label + ": number of flips");
        }
    }
    return polygons;
}

}  // namespace

int main(int count, char** arguments) {
    if (count != 2) return std::fprintf(stderr, "usage: flip_triangles_test vectors.txt\n"), 2;
    std::ifstream file(arguments[1]);
    expect(compare(file) > 30, "vectors are read");

    expect(throws<std::int32_t>({0, 1, 2, 0, 2, -1}), "a negative index is refused");
    expect(throws<std::uint32_t>({0, 1, 2, 0, 2, 4}), "an index beyond the points is refused");
    expect(throws<std::int64_t>({0, 1, std::int64_t(1) << 32}), "an index beyond 32 bits is refused");

    for (const double scale : {0.0, -1.0, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()})
        try {
            std::vector<int> triangles = {0, 1, 2};
            const std::array<double, 6> points = {0, 0, 1, 0, 0, 1};
            flip_triangles::flip(triangles.data(), std::size_t(3), points.data(), std::size_t(3), flip_triangles::By::quads,
                                 std::size_t(2), Order::walk, scale);
            expect(false, "quads without a positive scale are refused");
        } catch (const std::invalid_argument&) {
        }

    std::vector<std::uint16_t> empty;
    expect(flip_triangles::flip(empty, std::vector<std::vector<std::pair<float, float>>>{}) == 0, "empty input is accepted");

    // The only triangle that is not degenerate has a NaN; the integer points are collinear.
    const double nan = std::numeric_limits<double>::quiet_NaN();
    const std::vector<double> line = {0, 0, 33554432, 0, -33554432, 0, 1, 0, nan, 0, 0, 1};
    for (auto by : {flip_triangles::By::l1, flip_triangles::By::euclidean, flip_triangles::By::delaunay}) {
        std::vector<int> triangles = {0, 1, 2, 0, 2, 3, 3, 4, 5};
        expect(flip_triangles::flip(triangles.data(), triangles.size(), line.data(), std::size_t(6), by) == 0,
               "no diagonal at a NaN is flipped");
    }

    // Many equal edges take linear time; quadratic time would be a minute.
    std::vector<std::uint32_t> zeros(180000, 0), equal;
    for (std::uint32_t i = 0; i < 180000; i++) equal.push_back(i % 3);
    const std::vector<double> points(6, 1.0);
    expect(flip_triangles::flip(zeros.data(), zeros.size(), points.data(), std::size_t(3)) == 0, "zeros");
    expect(flip_triangles::flip(equal.data(), equal.size(), points.data(), std::size_t(3)) == 0, "equal triangles");

    if (failures == 0) std::puts("all tests passed");
    return failures != 0;
}
