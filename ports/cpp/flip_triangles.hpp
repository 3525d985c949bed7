// Make a triangulated polygon cheaper to draw by flipping diagonals, on the same vertices. C++17.
// SPDX-License-Identifier: MIT
//
//     std::vector<uint32_t> triangles = mapbox::earcut<uint32_t>(polygon);
//     flip_triangles::flip(triangles, polygon);
//
// Two triangles that share an edge form a quadrilateral. If it is strictly convex, a flip replaces
// the shared edge by the other diagonal. Then the triangles are put in a walk from neighbour to
// neighbour. ORDER.md specifies the order of flips and the walk, so that this file,
// flip-triangles.js and Python's triangulators.flip return the same triangles.

#pragma once

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
#endif
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#endif

namespace flip_triangles {

/** The test of a flip: l1 and euclidean require a shorter diagonal, by |dx| + |dy| or Euclidean
 *  length; delaunay requires a vertex inside the circumcircle of the other triangle. */
enum class By { l1, euclidean, delaunay };

/** The order of the result: a walk from neighbour to neighbour, in which a GPU transforms few vertices
 *  twice, or native: a flip's two triangles are at the positions of the old two. */
enum class Order { walk, native };

/** Flips diagonals and reuses memory between calls. Not thread-safe. */
class Flipper {
public:
    /** Flip diagonals in place until no flip is an improvement; then put the triangles in an order.
     *  Return the number of flips.
     *
     *  triangles: `length` indices, three per triangle, in the same orientation, as from earcut.
     *  coordinates: x and y of `points` points, beginning every `stride` numbers. Integers above
     *  2^53 in magnitude are treated as NaN: no diagonal at such a point is flipped.
     *  Throws std::out_of_range if an index is out of range; the triangles are then unchanged. */
    template <class Index, class Number>
    std::size_t operator()(Index* triangles, std::size_t length, const Number* coordinates,
                           std::size_t points, By by = By::l1, std::size_t stride = 2,
                           Order order = Order::walk) {
        static_assert(std::is_integral_v<Index> && std::is_arithmetic_v<Number>);
        xy.resize(2 * points);
        for (std::size_t i = 0; i < points; i++)
            store(i, coordinates[i * stride], coordinates[i * stride + 1]);
        return flip(triangles, length, by, order);
    }

    /** The same for a container of indices and the rings passed to earcut.hpp: containers of points
     *  that std::get accepts (std::array, std::pair, std::tuple). */
    template <class Triangles, class Rings>
    std::size_t operator()(Triangles& triangles, const Rings& polygon, By by = By::l1,
                           Order order = Order::walk) {
        std::size_t points = 0;
        for (const auto& ring : polygon) points += ring.size();
        xy.resize(2 * points);
        points = 0;
        for (const auto& ring : polygon)
            for (const auto& point : ring) store(points++, std::get<0>(point), std::get<1>(point));
        return flip(triangles.data(), triangles.size(), by, order);
    }

    /** Put triangles in a walk from neighbour to neighbour, in place and in linear time. Triangles are
     *  rotated, not mirrored. Throws std::out_of_range if an index is not below `points`. */
    template <class Index>
    void reorder(Index* triangles, std::size_t length, std::size_t points) {
        read(triangles, length, points);
        link();
        walk(triangles);
    }

private:
    std::vector<double> xy;
    std::vector<std::uint32_t> origin;  // index of the point where a half-edge begins
    std::vector<std::int32_t> twin;     // the opposite half-edge; negative if there is none
    std::vector<std::int32_t> stack;    // half-edges to test
    std::vector<std::int32_t> slots;    // hash table of half-edges by their end points
    std::vector<unsigned char> queued;  // whether a half-edge is on the stack
    std::vector<std::int32_t> entry;    // half-edge over which the walk enters a triangle, FREE or ROOT
    std::vector<std::int32_t> size;     // triangles in the branch of a triangle
    std::vector<std::int32_t> queue;    // triangles of a component, breadth first
    std::vector<std::int32_t> walked;   // triangles in walk order
    std::vector<unsigned char> met;     // whether a vertex belongs to an earlier triangle of the walk
    static constexpr std::int32_t FREE = -2, ROOT = -1;

    struct Point {
        double x, y;
    };

    static std::uint32_t next(std::uint32_t e) { return e % 3 == 2 ? e - 2 : e + 1; }
    static std::uint32_t previous(std::uint32_t e) { return e % 3 == 0 ? e + 2 : e - 1; }
    Point at(std::uint32_t point) const { return {xy[2 * std::size_t(point)], xy[2 * std::size_t(point) + 1]}; }

    template <class Number>
    static double as_double(Number value) {
        if constexpr (std::is_integral_v<Number> && sizeof(Number) > 4) {
            constexpr auto max_exact = Number(std::int64_t(1) << 53);
            bool exact = value <= max_exact;
            if constexpr (std::is_signed_v<Number>) exact = exact && value >= -max_exact;
            if (!exact) return std::numeric_limits<double>::quiet_NaN();
        }
        return static_cast<double>(value);
    }

    template <class Number>
    void store(std::size_t point, Number x, Number y) {
        xy[2 * point] = as_double(x);
        xy[2 * point + 1] = as_double(y);
    }

    // Copy the indices to `origin`.
    template <class Index>
    void read(const Index* triangles, std::size_t length, std::size_t points) {
        const std::size_t count = length - length % 3;
        if (count > std::size_t(std::numeric_limits<std::int32_t>::max()) ||
            points > std::size_t(std::numeric_limits<std::uint32_t>::max()))
            throw std::length_error("flip_triangles: input is too large (max 2^31 indices, 2^32 points)");
        origin.resize(count);
        for (std::size_t e = 0; e < count; e++) {
            // As an unsigned number, a negative index is large.
            if (static_cast<std::make_unsigned_t<Index>>(triangles[e]) >= points)
                throw std::out_of_range("flip_triangles: index out of range");
            origin[e] = static_cast<std::uint32_t>(triangles[e]);
        }
    }

    template <class Index>
    std::size_t flip(Index* triangles, std::size_t length, By by, Order order) {
        read(triangles, length, xy.size() / 2);
        if (origin.size() <= 3) return 0;
        const std::size_t flips = run(by);
        if (order == Order::walk)
            walk(triangles);
        else
            for (std::size_t e = 0; e < origin.size(); e++) triangles[e] = static_cast<Index>(origin[e]);
        return flips;
    }

    static std::size_t at_index(std::int32_t value) { return static_cast<std::size_t>(value); }

    // The twin of the k-th half-edge of a triangle, beginning with its entry, or a negative number.
    std::int32_t twin_of(std::int32_t triangle, std::int32_t k) const {
        const std::int32_t first = entry[at_index(triangle)];
        return twin[at_index(3 * triangle + ((first < 0 ? 0 : first) + k) % 3)];
    }

    // Write the triangles of `origin` in walk order, given their twins.
    template <class Index>
    void walk(Index* triangles) {
        const std::size_t m = origin.size() / 3;
        entry.assign(m, FREE);
        size.assign(m, 1);
        queue.resize(m);
        walked.clear();
        for (std::size_t first = 0; first < m; first++)
            if (entry[first] == FREE) walk_component(find_leaf(static_cast<std::int32_t>(first)));
        std::uint32_t last = 0;
        for (const auto vertex : origin) last = vertex > last ? vertex : last;
        met.assign(std::size_t(last) + 1, 0);
        for (std::size_t t = 0; t < m; t++) {
            const std::uint32_t* vertex = &origin[3 * at_index(walked[t])];
            std::uint32_t a = vertex[0], b = vertex[1], c = vertex[2];
            if (met[c] && met[b] && !met[a])
                std::tie(a, b, c) = std::make_tuple(b, c, a);
            else if (met[c] && !met[b])
                std::tie(a, b, c) = std::make_tuple(c, a, b);
            triangles[3 * t] = static_cast<Index>(a);
            triangles[3 * t + 1] = static_cast<Index>(b);
            triangles[3 * t + 2] = static_cast<Index>(c);
            met[a] = met[b] = met[c] = 1;
        }
    }

    // Append the component of a triangle to `walked`.
    void walk_component(std::int32_t root) {
        entry[at_index(root)] = ROOT;
        queue[0] = root;
        std::size_t tail = 1;
        for (std::size_t head = 0; head < tail; head++)
            for (std::int32_t k = 0; k < 3; k++) {
                const std::int32_t f = twin_of(queue[head], k);
                if (f < 0 || entry[at_index(f / 3)] != FREE) continue;
                entry[at_index(f / 3)] = f;
                queue[tail++] = f / 3;
            }
        while (--tail > 0) {  // descendants come later
            const std::size_t branch = at_index(queue[tail]);
            size[at_index(twin[at_index(entry[branch])] / 3)] += size[branch];
        }
        stack[0] = root;
        std::size_t height = 1;
        while (height > 0) {
            const std::int32_t triangle = stack[--height];
            const std::size_t begin = height;
            walked.push_back(triangle);
            for (std::int32_t k = 0; k < 3; k++) {
                const std::int32_t f = twin_of(triangle, k);
                if (f < 0 || entry[at_index(f / 3)] != f) continue;
                std::size_t at = height++;  // at most three branches: insertion sort, the smallest on top
                for (; at > begin && size[at_index(stack[at - 1])] < size[at_index(f / 3)]; at--)
                    stack[at] = stack[at - 1];
                stack[at] = f / 3;
            }
        }
    }

    // The first triangle with at most one neighbour, breadth first from `first`; otherwise `first`.
    std::int32_t find_leaf(std::int32_t first) {
        std::int32_t leaf = -1;
        entry[at_index(first)] = ROOT;
        queue[0] = first;
        std::size_t tail = 1;
        for (std::size_t head = 0; head < tail && leaf < 0; head++) {
            int neighbours = 0;
            for (std::int32_t e = 3 * queue[head], end = e + 3; e < end; e++) {
                const std::int32_t f = twin[at_index(e)];
                if (f < 0) continue;
                neighbours++;
                if (entry[at_index(f / 3)] != FREE) continue;
                entry[at_index(f / 3)] = ROOT;
                queue[tail++] = f / 3;
            }
            if (neighbours < 2) leaf = queue[head];
        }
        while (tail > 0) entry[at_index(queue[--tail])] = FREE;
        return leaf < 0 ? first : leaf;
    }

    void push(std::uint32_t e, std::size_t& size) {
        if (twin[e] >= 0 && !queued[e]) {
            queued[e] = 1;
            stack[size++] = static_cast<std::int32_t>(e);
        }
    }

    std::size_t run(By by) {
        std::size_t size = link(), flips = 0;
        const double orientation = by == By::delaunay ? first_orientation() : 0.0;
        while (size) {
            const auto e = static_cast<std::uint32_t>(stack[--size]);
            queued[e] = 0;
            if (twin[e] < 0) continue;
            const auto f = static_cast<std::uint32_t>(twin[e]);

            // The diagonal b-c is shared by the triangles a, b, c of e and d, c, b of f.
            const std::uint32_t e1 = next(e), e2 = previous(e), f1 = next(f), f2 = previous(f);
            const Point a = at(origin[e2]), b = at(origin[e]), c = at(origin[f]), d = at(origin[f2]);
            if (!is_better(by, orientation, a, b, c, d) || !is_convex(a, b, c, d)) continue;

            flips++;
            origin[e] = origin[f2];
            origin[f] = origin[e2];
            const std::int32_t below = twin[f2], above = twin[e2];
            twin[e] = below;
            twin[f] = above;
            twin[e2] = static_cast<std::int32_t>(f2);
            twin[f2] = static_cast<std::int32_t>(e2);
            if (below >= 0) twin[std::size_t(below)] = static_cast<std::int32_t>(e);
            if (above >= 0) twin[std::size_t(above)] = static_cast<std::int32_t>(f);
            push(e, size);
            push(f, size);
            push(e1, size);
            push(f1, size);
        }
        return flips;
    }

    // Link all half-edges with their twins and push one of each pair on the stack; return its size.
    //
    // Unlinked half-edges between the same two points have the same direction and form a circular
    // list: `twin` holds -2 - next, and the last one refers to the first. A slot of the hash table
    // holds the last one, so both ends of the list are found in constant time, for any number of
    // equal edges.
    std::size_t link() {
        const auto count = static_cast<std::uint32_t>(origin.size());
        unsigned bits = 4;
        while ((std::size_t(1) << bits) < std::size_t(count) + count / 2) bits++;
        const std::size_t mask = (std::size_t(1) << bits) - 1;
        slots.assign(mask + 1, -1);
        twin.resize(count);
        queued.assign(count, 0);
        stack.resize(count);
        std::size_t size = 0;
        for (std::uint32_t e = 0; e < count; e++) {
            const std::uint32_t tail = origin[e], head = origin[next(e)];
            const std::uint32_t low = tail < head ? tail : head, high = tail < head ? head : tail;
            std::size_t slot = ((low + high * 0x9e3779b1u) * 0x85ebca6bu) >> (32 - bits);
            const auto edge = static_cast<std::int32_t>(e);
            std::int32_t last;
            bool against = false;  // whether the unlinked half-edges run from head to tail
            for (; (last = slots[slot]) >= 0; slot = (slot + 1) & mask) {
                const auto candidate = static_cast<std::uint32_t>(last);
                against = origin[candidate] == head && origin[next(candidate)] == tail;
                if (against || (origin[candidate] == tail && origin[next(candidate)] == head)) break;
            }
            if (last < 0 || twin[std::size_t(last)] >= 0) {
                slots[slot] = edge;
                twin[e] = -2 - edge;
            } else if (against) {
                const std::int32_t first = -2 - twin[std::size_t(last)];
                twin[std::size_t(last)] = twin[std::size_t(first)];
                twin[std::size_t(first)] = edge;
                twin[e] = first;
                queued[std::size_t(first)] = 1;
                stack[size++] = first;
            } else {
                slots[slot] = edge;
                twin[e] = twin[std::size_t(last)];
                twin[std::size_t(last)] = -2 - edge;
            }
        }
        return size;
    }

    // Orientation of the first triangle that is not degenerate: 1 (counter-clockwise), -1 or 0.
    double first_orientation() const {
        FLIP_TRIANGLES_AS_WRITTEN
        for (std::size_t e = 0; e < origin.size(); e += 3) {
            const Point a = at(origin[e]), b = at(origin[e + 1]), c = at(origin[e + 2]);
            const double turn = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
            if (turn > 0.0 || turn < 0.0) return turn > 0.0 ? 1.0 : -1.0;
        }
        return 0.0;
    }

    static bool is_integer(double value) {
        return std::abs(value) <= 33554432.0 && value == std::floor(value);  // 2^25
    }
    static bool is_integer(Point a, Point b, Point c, Point d) {
        return is_integer(a.x) && is_integer(a.y) && is_integer(b.x) && is_integer(b.y) &&
               is_integer(c.x) && is_integer(c.y) && is_integer(d.x) && is_integer(d.y);
    }

    static constexpr double UNDERFLOW_BOUND = 1e-300;  // exceeds the underflow error of a product

    // Whether the triangles a, b, d and a, d, c have a certain orientation, and the same one.
    static bool is_convex(Point a, Point b, Point c, Point d) {
        FLIP_TRIANGLES_AS_WRITTEN
        const double x = d.x - a.x, y = d.y - a.y;
        const double p = (b.x - a.x) * y, q = (b.y - a.y) * x;
        const double r = x * (c.y - a.y), s = y * (c.x - a.x);
        const double turn1 = p - q, turn2 = r - s;
        if (!(turn1 > 0.0 ? turn2 > 0.0 : turn1 < 0.0 && turn2 < 0.0)) return false;
        return (std::abs(turn1) > 4e-16 * (std::abs(p) + std::abs(q)) + UNDERFLOW_BOUND &&
                std::abs(turn2) > 4e-16 * (std::abs(r) + std::abs(s)) + UNDERFLOW_BOUND) ||
               is_integer(a, b, c, d);
    }

    static bool is_better(By by, double orientation, Point a, Point b, Point c, Point d) {
        FLIP_TRIANGLES_AS_WRITTEN
        if (by == By::delaunay) return in_circle(orientation, a, b, c, d);
        const double x = d.x - a.x, y = d.y - a.y, u = c.x - b.x, v = c.y - b.y;
        if (by == By::l1) return std::abs(x) + std::abs(y) < std::abs(u) + std::abs(v);
        return x * x + y * y < u * u + v * v;
    }

    // Whether d certainly lies inside the circle through a, b, c, which are counter-clockwise if
    // orientation > 0.
    static bool in_circle(double orientation, Point a, Point b, Point c, Point d) {
        FLIP_TRIANGLES_AS_WRITTEN
        constexpr double max_exact = 1.6e8;  // up to this size, integers give an exact result
        const double px = a.x - d.x, py = a.y - d.y, qx = b.x - d.x, qy = b.y - d.y;
        const double rx = c.x - d.x, ry = c.y - d.y;
        const double p = px * px + py * py, q = qx * qx + qy * qy, r = rx * rx + ry * ry;
        const double i = qx * ry - qy * rx, j = rx * py - ry * px, k = px * qy - py * qx;
        const double inside = (p * i + q * j + r * k) * orientation, size = p + q + r;
        if (std::abs(inside) > 1e-15 * size * size + UNDERFLOW_BOUND) return inside > 0.0;
        if ((size <= max_exact && inside == 0.0) || !is_integer(a, b, c, d)) return false;
        if (size <= max_exact) return inside > 0.0;
        return sign_of_products(p, i, q, j, r, k) * orientation > 0.0;
    }

    // Sign of p i + q j + r k for integers up to 2^53 in magnitude, in pieces of 27 bits.
    static double sign_of_products(double p, double i, double q, double j, double r, double k) {
        constexpr std::int64_t piece = std::int64_t(1) << 27;
        std::int64_t high = 0, middle = 0, low = 0;
        for (const auto& [left, right] : {std::pair(p, i), std::pair(q, j), std::pair(r, k)}) {
            const auto a = static_cast<std::int64_t>(left), b = static_cast<std::int64_t>(right);
            const std::int64_t a1 = a / piece, a0 = a % piece, b1 = b / piece, b0 = b % piece;
            high += a1 * b1;
            middle += a1 * b0 + a0 * b1;
            low += a0 * b0;
        }
        middle += low / piece;
        low %= piece;
        high += middle / piece;
        middle %= piece;
        // A lower piece is smaller in magnitude than one unit of the piece above.
        const std::int64_t first = high ? high : middle ? middle : low;
        return first > 0 ? 1.0 : first < 0 ? -1.0 : 0.0;
    }
};

/** `Flipper` for one call: `flip(indices, length, coordinates, points[, by[, stride[, order]]])` or
 *  `flip(indices, polygon[, by[, order]])`. */
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
