// Time flips and earcut.hpp; see scripts/flips_times.py.

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <mapbox/earcut.hpp>
#include <string>
#include <vector>

#include "../../ports/cpp/flip_triangles.hpp"

namespace {

using Polygon = std::vector<std::vector<std::array<double, 2>>>;
using Indices = std::vector<std::uint32_t>;

template <class T>
std::vector<T> read(const std::string& path) {
    std::ifstream file(path, std::ios::binary | std::ios::ate);
    std::vector<T> values(static_cast<std::size_t>(file.tellg()) / sizeof(T));
    file.seekg(0);
    file.read(reinterpret_cast<char*>(values.data()), static_cast<std::streamsize>(values.size() * sizeof(T)));
    return values;
}

// CPU time, so that other programs do not count.
template <class Work>
double milliseconds(Work work) {
    const auto start = std::clock();
    work();
    return static_cast<double>(std::clock() - start) * 1e3 / CLOCKS_PER_SEC;
}

}  // namespace

int main(int, char** arguments) {
    using flip_triangles::By;
    const std::string folder = std::string(arguments[1]) + "/";
    const int rounds = std::atoi(arguments[2]);
    const auto points = read<double>(folder + "points.f64");
    const auto bounds = read<std::int32_t>(folder + "bounds.i32"), rings = read<std::int32_t>(folder + "rings.i32");
    std::vector<Polygon> polygons;
    for (std::size_t i = 2, at = 0; i < bounds.size(); i += 2) {
        Polygon polygon;
        const auto first = static_cast<std::size_t>(bounds[i - 2]);
        std::size_t begin = first;
        const auto count = static_cast<std::size_t>(rings[at++]);
        for (std::size_t ring = 0; ring < count; ring++) {
            const std::size_t end = first + static_cast<std::size_t>(rings[at++]);
            polygon.emplace_back();
            for (; begin < end; begin++) polygon.back().push_back({points[2 * begin], points[2 * begin + 1]});
        }
        polygons.push_back(polygon);
    }
    std::vector<Indices> raw(polygons.size());
    std::vector<std::vector<std::array<double, 2>>> vertices;  // all rings in one list, for refine
    for (const auto& polygon : polygons) {
        vertices.emplace_back();
        for (const auto& ring : polygon) vertices.back().insert(vertices.back().end(), ring.begin(), ring.end());
    }
    std::array<double, 7> minima;
    minima.fill(1e300);
    flip_triangles::Flipper flipper;
    for (int round = 0; round < rounds; round++) {
        minima[0] = std::min(minima[0], milliseconds([&] {
            for (std::size_t i = 0; i < raw.size(); i++) raw[i] = mapbox::earcut<std::uint32_t>(polygons[i]);
        }));
        for (std::size_t test = 0; test < 6; test++) {
            auto copies = raw;
            minima[test + 1] = std::min(minima[test + 1], milliseconds([&] {
                for (std::size_t i = 0; i < raw.size(); i++)
                    if (test < 3)
                        flipper(copies[i], polygons[i], static_cast<By>(test));
                    else if (test == 3)
                        flipper(copies[i], polygons[i], By::l1, flip_triangles::Order::native);
                    else if (test == 5)
                        flipper(copies[i], polygons[i], By::quads, flip_triangles::Order::walk, 1.0);
                    else
                        mapbox::refine(copies[i], vertices[i]);
            }));
        }
    }
    std::printf("{\"earcut\": %.4f, \"l1\": %.4f, \"euclidean\": %.4f, \"delaunay\": %.4f, \"l1 native\": %.4f, "
                "\"refine\": %.4f, \"quads\": %.4f}\n",
                minima[0], minima[1], minima[2], minima[3], minima[4], minima[5], minima[6]);
}
