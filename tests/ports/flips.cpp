// Flip the triangles of polygons in a folder (see languages.py) and write the results.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <string>
#include <vector>

#include "../../ports/cpp/flip_triangles.hpp"
#if __has_include(<mapbox/earcut.hpp>)
#include <mapbox/earcut.hpp>
#endif

namespace {

template <class T>
std::vector<T> read(const std::string& path) {
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    if (!file) std::exit(std::fprintf(stderr, "cannot read %s\n", path.c_str()));
    std::vector<T> values(static_cast<std::size_t>(file.tellg()) / sizeof(T));
    file.seekg(0);
    file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(values.size() * sizeof(T)));
    return values;
}

template <class T>
void write(const std::string& path, const std::vector<T>& values) {
    std::ofstream(path, std::ios::binary)
        .write(reinterpret_cast<const char*>(values.data()), static_cast<std::streamsize>(values.size() * sizeof(T)));
}

using Indices = std::vector<std::int32_t>;

// Exit if triangles in two types of indices differ.
template <class Index>
void require_equal(const std::vector<Index>& indices, const Indices& expected) {
    if (!std::equal(indices.begin(), indices.end(), expected.begin(), [](Index a, std::int32_t b) { return a == Index(b); })) {
        std::fprintf(stderr, "triangles differ by type of indices or coordinates\n");
        std::exit(1);
    }
}

// Flip with other types of indices and coordinates and points in rings; exit if the result differs.
template <class Index, class Number>
void expect_equal(const Indices& triangles, const Indices& expected, const std::vector<double>& xy, flip_triangles::By by,
                  double scale) {
    std::vector<Index> indices(triangles.begin(), triangles.end());
    std::vector<std::vector<std::array<Number, 2>>> polygon(1);
    for (std::size_t i = 0; i < xy.size(); i += 2)
        polygon[0].push_back({static_cast<Number>(xy[i]), static_cast<Number>(xy[i + 1])});
    flip_triangles::flip(indices, polygon, by, flip_triangles::Order::walk, scale);
    require_equal(indices, expected);
}

bool is_integer(const std::vector<double>& xy) {
    for (double v : xy)
        if (!(std::abs(v) <= 16777216.0) || v != std::floor(v)) return false;  // 2^24: exact in floats
    return true;
}

}  // namespace

int main(int, char** arguments) {
    const std::string folder = std::string(arguments[1]) + "/";
    const auto points = read<double>(folder + "points.f64");
    const auto triangles = read<std::int32_t>(folder + "triangles.i32");
    const auto bounds = read<std::int32_t>(folder + "bounds.i32");
    using flip_triangles::Order;
    const std::array<const char*, 8> names = {"l1", "euclidean", "delaunay", "l1-native", "reorder",
                                              "quads@0.125", "quads@1", "quads@3.7"};
    const std::array<double, 3> scales = {0.125, 1.0, 3.7};
    flip_triangles::Flipper flipper;
    for (std::size_t test = 0; test < names.size(); test++) {
        const auto by = test > 4 ? flip_triangles::By::quads : static_cast<flip_triangles::By>(test % 3);
        const double scale = test > 4 ? scales[test - 5] : 0.0;
        const auto order = test == 3 ? Order::native : Order::walk;
        auto result = triangles;
        Indices counts;
        for (std::size_t i = 2; i < bounds.size(); i += 2) {
            const auto begin = result.begin() + bounds[i - 1], end = result.begin() + bounds[i + 1];
            const Indices before(begin, end);
            const std::vector<double> xy(points.begin() + 2 * bounds[i - 2], points.begin() + 2 * bounds[i]);
            std::int32_t* indices = result.data() + bounds[i - 1];
            if (test == 4) {
                flipper.reorder(indices, before.size(), xy.size() / 2);
                std::vector<std::uint64_t> wide(before.begin(), before.end());
                flip_triangles::reorder(wide.data(), wide.size(), xy.size() / 2);
                require_equal(wide, Indices(begin, end));
                counts.push_back(0);
                continue;
            }
            counts.push_back(static_cast<std::int32_t>(
                flipper(indices, before.size(), xy.data(), xy.size() / 2, by, 2, order, scale)));
            if (order == Order::native) continue;
            const Indices after(begin, end);
            if (xy.size() < 2 * 65536) expect_equal<std::uint16_t, double>(before, after, xy, by, scale);
            if (is_integer(xy)) {
                expect_equal<std::uint32_t, float>(before, after, xy, by, scale);
                expect_equal<std::int64_t, std::int32_t>(before, after, xy, by, scale);
                expect_equal<std::uint64_t, std::int64_t>(before, after, xy, by, scale);
            }
        }
        write(folder + "cpp-" + names[test] + ".i32", result);
        write(folder + "cpp-" + names[test] + "-counts.i32", counts);
    }
#if __has_include(<mapbox/earcut.hpp>)
    auto refined = triangles;
    for (std::size_t i = 2; i < bounds.size(); i += 2) {
        std::vector<std::array<double, 2>> xy;
        for (auto p = bounds[i - 2]; p < bounds[i]; p++) xy.push_back({points[2 * p], points[2 * p + 1]});
        std::vector<std::uint32_t> indices(triangles.begin() + bounds[i - 1], triangles.begin() + bounds[i + 1]);
        mapbox::refine(indices, xy);
        std::copy(indices.begin(), indices.end(), refined.begin() + bounds[i - 1]);
    }
    write(folder + "cpp-earcut-refine.i32", refined);
#endif
}
