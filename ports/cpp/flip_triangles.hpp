// Make a triangulated polygon cheaper to draw by flipping diagonals, on the same vertices. C++17.
// SPDX-License-Identifier: MIT
//
//     std::vector<uint32_t> triangles = mapbox::earcut<uint32_t>(polygon);
//     flip_triangles::flip(triangles, polygon);
//
// ORDER.md specifies the order of flips and the walk; JavaScript and Python return the same triangles.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <tuple>
#include <type_traits>
#include <utility>
#include <vector>

// Round each product and sum separately, as in the other languages: no contraction (FMA).
#if defined(__clang__)
#define FLIP_TRIANGLES_AS_WRITTEN _Pragma("clang fp contract(off)")
#elif defined(_MSC_VER)
#define FLIP_TRIANGLES_AS_WRITTEN __pragma(fp_contract(off))
#else
#define FLIP_TRIANGLES_AS_WRITTEN
#pragma GCC push_options  // ignored by other compilers
#pragma GCC optimize("fp-contract=off")
#endif

namespace flip_triangles {

/** The test of a flip: l1 and euclidean require a shorter diagonal, by |dx| + |dy| or Euclidean length; delaunay a
 *  vertex inside the other triangle's circumcircle; quads fewer expected 2x2 pixel quads (scale: pixels per unit). */
enum class By { l1, euclidean, delaunay, quads };

/** walk: from neighbour to neighbour, so that a GPU transforms few vertices twice; native: at the old positions. */
enum class Order { walk, native };

/** Flips diagonals and reuses memory between calls. Not thread-safe. */
class Flipper {
public:
    /** Flip diagonals in place until no flip is an improvement, order the triangles, and return the number of flips.
     *  triangles: `length` indices, three per triangle, in the same orientation, as from earcut.
     *  coordinates: x and y of `count` points, beginning every `stride` numbers. Integers of
     *  2^53 or more in magnitude are treated as NaN: no diagonal at such a point is flipped. Throws, before any
     *  change, std::out_of_range (an index) or std::invalid_argument (By::quads without a positive scale). */
    template <class Index, class Number>
    std::size_t operator()(Index* triangles, std::size_t length, const Number* coordinates, std::size_t count,
                           By by = By::l1, std::size_t stride = 2, Order order = Order::walk, double scale = 0.0) {
        static_assert(std::is_integral_v<Index> && std::is_arithmetic_v<Number>);
        points.resize(count);
        for (std::size_t i = 0; i < count; i++)
            points[i] = {as_double(coordinates[i * stride]), as_double(coordinates[i * stride + 1])};
        return flip(triangles, length, by, order, scale);
    }

    /** The same for a container of indices and the rings passed to earcut.hpp, of points that std::get accepts. */
    template <class Triangles, class Rings>
    std::size_t operator()(Triangles& triangles, const Rings& polygon, By by = By::l1, Order order = Order::walk,
                           double scale = 0.0) {
        points.clear();
        for (const auto& ring : polygon)
            for (const auto& point : ring)
                points.push_back({as_double(std::get<0>(point)), as_double(std::get<1>(point))});
        return flip(triangles.data(), triangles.size(), by, order, scale);
    }

    /** Put triangles in a walk from neighbour to neighbour. Throws std::out_of_range if an index is `count` or more. */
    template <class Index>
    void reorder(Index* triangles, std::size_t length, std::size_t count) {
        read(triangles, length, count);
        walk(triangles);
    }

private:
    using Id = std::uint32_t;  // of a point, a half-edge or a triangle
    static constexpr Id NONE = 1u << 31, FREE = NONE, ROOT = NONE + 1;
    static constexpr double UNDERFLOW_BOUND = 1e-300;  // exceeds the underflow error of a product
    struct Point {
        double x, y;
    };

    std::vector<Point> points;
    std::vector<double> quads;          // expected quads of a triangle
    std::vector<Id> origin;             // index of the point where a half-edge begins
    std::vector<Id> twin;               // the opposite half-edge; NONE or above if there is none
    std::vector<Id> stack;              // half-edges to test
    std::size_t height = 0;             // of the stack
    std::vector<Id> slots;              // hash table of half-edges by their end points
    std::vector<unsigned char> queued;  // whether a half-edge is on the stack
    std::vector<Id> entry;              // half-edge over which the walk enters a triangle, FREE or ROOT
    std::vector<Id> size;               // triangles in the branch of a triangle
    std::vector<Id> queue;              // triangles of a component, breadth first
    std::vector<unsigned char> met;     // whether a vertex belongs to an earlier triangle of the walk

    static Id next(Id e) { return e % 3 == 2 ? e - 2 : e + 1; }
    static Id previous(Id e) { return e % 3 == 0 ? e + 2 : e - 1; }
    Point start(Id e) const { return points[origin[e]]; }

    template <class Number>
    static double as_double(Number value) {
        const double number = static_cast<double>(value);
        return !std::is_integral_v<Number> || std::abs(number) < 9007199254740992.0 ? number : NAN;  // 2^53
    }

    // Copy the indices to `origin` and link the half-edges.
    template <class Index>
    void read(const Index* triangles, std::size_t length, std::size_t count) {
        if (length >= NONE || count > std::size_t(std::numeric_limits<Id>::max()))
            throw std::length_error("flip_triangles: input is too large (max 2^31 indices, 2^32 points)");
        origin.resize(length - length % 3);
        for (std::size_t e = 0; e < origin.size(); e++) {
            // As an unsigned number, a negative index is large.
            if (static_cast<std::make_unsigned_t<Index>>(triangles[e]) >= count)
                throw std::out_of_range("flip_triangles: index out of range");
            origin[e] = static_cast<Id>(triangles[e]);
        }
        link();
    }

    template <class Index>
    std::size_t flip(Index* triangles, std::size_t length, By by, Order order, double scale) {
        if (by == By::quads && !(scale > 0.0 && scale <= std::numeric_limits<double>::max()))
            throw std::invalid_argument("flip_triangles: By::quads needs scale, pixels per unit "
                                        "(map tile: px / extent; font: px / units per em)");
        read(triangles, length, points.size());
        const std::size_t flips = run(by, scale);
        if (order == Order::walk)
            walk(triangles);
        else
            for (std::size_t e = 0; e < origin.size(); e++) triangles[e] = static_cast<Index>(origin[e]);
        return flips;
    }

    // Write the triangles of `origin` in walk order, given their twins.
    template <class Index>
    void walk(Index* triangles) {
        const Id m = static_cast<Id>(origin.size() / 3);
        entry.assign(m, FREE);
        size.assign(m, 1);
        queue.resize(m);
        met.assign(m ? *std::max_element(origin.begin(), origin.end()) + std::size_t(1) : 0, 0);
        for (Id first = 0; first < m; first++) {
            if (entry[first] != FREE) continue;
            Id root = first;
            for (Id count = search(first, &root); count > 0;) entry[queue[--count]] = FREE;
            for (Id count = search(root, nullptr); --count > 0;)  // descendants come later
                size[twin[entry[queue[count]]] / 3] += size[queue[count]];
            stack[0] = root;
            height = 1;
            while (height > 0) {
                const Id triangle = stack[--height], *vertex = &origin[3 * triangle];
                // The new vertex comes last.
                const std::size_t shift = !met[vertex[2]] ? 0 : !met[vertex[1]] ? 2 : !met[vertex[0]] ? 1 : 0;
                for (std::size_t k = 0; k < 3; k++) *triangles++ = static_cast<Index>(vertex[(k + shift) % 3]);
                met[vertex[0]] = met[vertex[1]] = met[vertex[2]] = 1;
                const std::size_t begin = height;
                for (Id k = 0; k < 3; k++) {
                    const Id f = twin_of(triangle, k);
                    if (f >= NONE || entry[f / 3] != f) continue;
                    std::size_t at = height++;  // at most three branches: insertion sort, the smallest on top
                    for (; at > begin && size[stack[at - 1]] < size[f / 3]; at--) stack[at] = stack[at - 1];
                    stack[at] = f / 3;
                }
            }
        }
    }

    // The twin of the k-th half-edge of a triangle, beginning with its entry, or a value of NONE or above.
    Id twin_of(Id triangle, Id k) const {
        return twin[3 * triangle + (entry[triangle] >= NONE ? k : (entry[triangle] + k) % 3)];
    }

    // List the component of a triangle in `queue`, breadth first, and return the number of triangles.
    // If there is a leaf, set it to the first triangle with at most one neighbour and stop there.
    Id search(Id root, Id* leaf) {
        entry[root] = ROOT;
        queue[0] = root;
        Id count = 1;
        for (Id head = 0; head < count; head++) {
            Id neighbours = 0;
            for (Id k = 0; k < 3; k++) {
                const Id f = twin_of(queue[head], k);
                if (f >= NONE) continue;
                neighbours++;
                if (entry[f / 3] != FREE) continue;
                entry[f / 3] = leaf ? ROOT : f;
                queue[count++] = f / 3;
            }
            if (!leaf || neighbours > 1) continue;
            *leaf = queue[head];
            break;
        }
        return count;
    }

    // Replace the diagonal of e, push the sides of its quadrilateral, and return 1. The twin gets the triangle `lower`.
    std::size_t flip_edge(Id e, double lower, double upper) {
        const Id f = twin[e], e2 = previous(e), f2 = previous(f), below = twin[f2], above = twin[e2];
        quads[f / 3] = lower;
        quads[e / 3] = upper;
        origin[f] = origin[e2];
        origin[e] = origin[f2];
        twin[e] = below;
        twin[f] = above;
        twin[e2] = f2;
        twin[f2] = e2;
        if (below < NONE) twin[below] = e;
        if (above < NONE) twin[above] = f;
        for (const Id side : {e, f, next(e), next(f)})
            if (twin[side] < NONE && !queued[side]) queued[stack[height++] = side] = 1;
        return 1;
    }

    std::size_t run(By by, double scale) {
        std::size_t flips = 0;
        const double orientation = by == By::delaunay ? first_orientation() : 0.0;
        quads.assign(origin.size() / 3, 0.0);
        for (Id e = 0; by == By::quads && e < origin.size(); e += 3)
            quads[e / 3] = expected_quads(start(e), start(e + 1), start(e + 2), scale);
        while (height) {
            const Id e = stack[--height], f = twin[e];
            queued[e] = 0;
            if (f >= NONE) continue;
            // The diagonal b-c is shared by the triangles a, b, c of e and d, c, b of f.
            const Id e2 = previous(e), f2 = previous(f);
            const Point a = start(e2), b = start(e), c = start(f), d = start(f2);
            if (by != By::quads) {
                if (is_better(by, orientation, a, b, c, d) && is_convex(a, b, c, d)) flips += flip_edge(e, 0.0, 0.0);
                continue;
            }
            if (!is_convex(a, b, c, d)) continue;
            const double lower = expected_quads(a, b, d, scale), upper = expected_quads(a, d, c, scale);
            const double before = quads[e / 3] + quads[f / 3];
            const bool single = is_less(lower + upper, before);
            Id second = NONE;
            double gain = 0.0, lower2 = 0.0, upper2 = 0.0;  // gain of both flips, new quads of the second
            for (int k = 0; !single && k < 4; k++) {
                // A side of the quadrilateral: its half-edge before the first flip, and the twin of that.
                const Id s = k == 0 ? f2 : k == 1 ? e2 : next(k == 2 ? e : f), g = twin[s];
                if (g >= NONE) continue;
                const Point w = k % 3 ? d : a, u = start(s), v = start(g), z = start(previous(g));
                if (!is_convex(w, u, v, z)) continue;
                const double p = expected_quads(w, u, z, scale), q = expected_quads(w, z, v, scale);
                const double total = before + quads[g / 3], after = (k % 2 ? upper : lower) + p + q;
                if (!is_less(after, total) || !(total - after > gain)) continue;
                gain = total - after;
                second = k == 0 ? e : k == 1 ? f : s;  // the half-edge after the first flip
                lower2 = p;
                upper2 = q;
            }
            if (single || second != NONE) flips += flip_edge(e, lower, upper);
            if (second != NONE) flips += flip_edge(second, lower2, upper2);
        }
        return flips;
    }

    // Link the half-edges and push one of each pair. Unlinked half-edges between the same points form a circular list:
    // `twin` holds ~next, the hash table the last one. So any number of equal edges takes linear time.
    void link() {
        const auto count = static_cast<Id>(origin.size());
        unsigned bits = 4;
        while ((std::size_t(1) << bits) < std::size_t(count) + count / 2) bits++;
        const std::size_t mask = (std::size_t(1) << bits) - 1;
        slots.assign(mask + 1, NONE);
        twin.resize(count);
        queued.assign(count, 0);
        stack.resize(count);
        height = 0;
        for (Id e = 0; e < count; e++) {
            const Id tail = origin[e], head = origin[next(e)];
            const Id low = std::min(tail, head), high = std::max(tail, head);
            std::size_t slot = ((low + high * 0x9e3779b1u) * 0x85ebca6bu) >> (32 - bits);
            Id last;
            bool against = false;  // whether the unlinked half-edges run from head to tail
            for (; (last = slots[slot]) < NONE; slot = (slot + 1) & mask) {
                against = origin[last] == head && origin[next(last)] == tail;
                if (against || (origin[last] == tail && origin[next(last)] == head)) break;
            }
            const bool is_first = last >= NONE || twin[last] < NONE;
            if (is_first || !against) {
                slots[slot] = e;
                twin[e] = is_first ? ~e : std::exchange(twin[last], ~e);
                continue;
            }
            const Id first = ~twin[last];
            twin[last] = twin[first];
            twin[first] = e;
            twin[e] = first;
            queued[stack[height++] = first] = 1;
        }
    }

    // Orientation of the first triangle that is not degenerate: 1 (counter-clockwise), -1 or 0.
    double first_orientation() const {
        FLIP_TRIANGLES_AS_WRITTEN
        for (Id e = 0; e < origin.size(); e += 3) {
            const Point a = start(e), b = start(e + 1), c = start(e + 2);
            const double turn = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
            if (turn > 0.0 || turn < 0.0) return turn > 0.0 ? 1.0 : -1.0;
        }
        return 0.0;
    }

    // Whether all coordinates are integers with exact orientations and lengths in doubles.
    static bool are_integers(std::initializer_list<Point> list) {
        const auto is_small = [](double v) { return std::abs(v) <= 33554432.0 && v == std::floor(v); };  // 2^25
        return std::all_of(list.begin(), list.end(), [&](Point p) { return is_small(p.x) && is_small(p.y); });
    }

    // Whether the triangles a, b, d and a, d, c certainly have the same nonzero orientation.
    static bool is_convex(Point a, Point b, Point c, Point d) {
        FLIP_TRIANGLES_AS_WRITTEN
        const double x = d.x - a.x, y = d.y - a.y;
        const double p = (b.x - a.x) * y, q = (b.y - a.y) * x, r = x * (c.y - a.y), s = y * (c.x - a.x);
        const double turn1 = p - q, turn2 = r - s;
        if (!(turn1 > 0.0 ? turn2 > 0.0 : turn1 < 0.0 && turn2 < 0.0)) return false;
        return (std::abs(turn1) > 4e-16 * (std::abs(p) + std::abs(q)) + UNDERFLOW_BOUND &&
                std::abs(turn2) > 4e-16 * (std::abs(r) + std::abs(s)) + UNDERFLOW_BOUND) ||
               are_integers({a, b, c, d});
    }

    // Whether the diagonal a-d is better than b-c. The triangles are counter-clockwise if orientation > 0.
    static bool is_better(By by, double orientation, Point a, Point b, Point c, Point d) {
        FLIP_TRIANGLES_AS_WRITTEN
        const double x = d.x - a.x, y = d.y - a.y, u = c.x - b.x, v = c.y - b.y;
        if (by == By::l1) return std::abs(x) + std::abs(y) < std::abs(u) + std::abs(v);
        if (by == By::euclidean) return x * x + y * y < u * u + v * v;
        return in_circle(orientation, a, b, c, d);
    }

    // Whether d certainly lies inside the circle through a, b, c, which are counter-clockwise if orientation > 0.
    static bool in_circle(double orientation, Point a, Point b, Point c, Point d) {
        FLIP_TRIANGLES_AS_WRITTEN
        const double px = a.x - d.x, py = a.y - d.y, qx = b.x - d.x, qy = b.y - d.y, rx = c.x - d.x, ry = c.y - d.y;
        const double p = px * px + py * py, q = qx * qx + qy * qy, r = rx * rx + ry * ry;
        const double i = qx * ry - qy * rx, j = rx * py - ry * px, k = px * qy - py * qx;
        const double inside = (p * i + q * j + r * k) * orientation, size = p + q + r;
        if (std::abs(inside) > 1e-15 * size * size + UNDERFLOW_BOUND) return inside > 0.0;
        if (!are_integers({a, b, c, d})) return false;
        // Here the exact sum is below 1.4e-15 size^2 < 2^60, so products that wrap around at 2^64 give it.
        const auto exact = [](double v) { return static_cast<std::uint64_t>(static_cast<std::int64_t>(v)); };
        const std::uint64_t sum = exact(p) * exact(i) + exact(q) * exact(j) + exact(r) * exact(k);
        return static_cast<double>(static_cast<std::int64_t>(sum)) * orientation > 0.0;
    }

    // Whether a sum of expected quads is less by more than rounding errors.
    static bool is_less(double after, double before) {
        FLIP_TRIANGLES_AS_WRITTEN
        return after < before - 1e-12 * (before + after);
    }

    // The mean number of 2x2 pixel quads with a pixel centre in a triangle, over all positions on the grid.
    static double expected_quads(Point a, Point b, Point c, double scale) {
        FLIP_TRIANGLES_AS_WRITTEN
        for (Point* point : {&a, &b, &c}) *point = {point->x * scale, point->y * scale};
        const double ux = b.x - a.x, uy = b.y - a.y, vx = c.x - b.x, vy = c.y - b.y, wx = a.x - c.x, wy = a.y - c.y;
        const double cross = ux * vy - uy * vx, s = cross < 0.0 ? -1.0 : 1.0, size = cross * s;
        if (cross == 0.0) return 0.0;
        const auto common = [&](double lost) {
            FLIP_TRIANGLES_AS_WRITTEN
            const double side = 1.0 - lost / size;
            return side > 0.0 ? side * side : 0.0;
        };
        const auto extent = [](double i, double j, double k) { return std::max({i, j, k}) - std::min({i, j, k}); };
        const auto triple = [&](double r, double u) {
            FLIP_TRIANGLES_AS_WRITTEN
            const double lost = std::min({0.0, r * uy, u * ux}) + std::min({0.0, r * vy, u * vx});
            return common(-lost - std::min({0.0, r * wy, u * wx}));
        };
        const double width = extent(a.x, b.x, c.x), tall = extent(a.y, b.y, c.y);
        const double pairs = common(width) + common(tall);
        const double diagonals = common(extent(a.x - a.y, b.x - b.y, c.x - c.y)) +
                                 common(extent(a.x + a.y, b.x + b.y, c.x + c.y));
        const double triples = triple(-s, -s) + triple(-s, s) + triple(s, -s) + triple(s, s);
        return 0.5 * size * (4.0 - 2.0 * pairs + (triples - diagonals - common(width + tall))) / 4.0;
    }
};

/** `Flipper` for one call, with the same arguments. */
template <class Triangles, class... Rest>
std::size_t flip(Triangles&& triangles, Rest&&... rest) {
    return Flipper()(std::forward<Triangles>(triangles), std::forward<Rest>(rest)...);
}

/** `Flipper::reorder` for one call. */
template <class Index>
void reorder(Index* triangles, std::size_t length, std::size_t points) {
    Flipper().reorder(triangles, length, points);
}

}  // namespace flip_triangles

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC pop_options
#endif
#undef FLIP_TRIANGLES_AS_WRITTEN
