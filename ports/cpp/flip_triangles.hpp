// Flips make the triangles of a polygon cheaper to draw, on the same vertices. C++17.
// SPDX-License-Identifier: MIT
//
//     std::vector<uint32_t> triangles = mapbox::earcut<uint32_t>(polygon);
//     flip_triangles::flip(triangles, polygon);
//
// Two triangles that share an edge are a quadrilateral. Where it is strictly convex it has another
// diagonal, and taking that one is a flip. ORDER.md says in which order flips are made, so that
// this file, flip-triangles.js and Python's triangulators.flip give the same triangles.

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

// Products and sums are rounded one by one, as in the other languages: never contracted to one.
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

/** What a flip must lessen: the diagonal's length, |dx| + |dy| (l1) or Euclidean, or whether a
 *  corner lies in the other triangle's circle (delaunay). */
enum class By { l1, euclidean, delaunay };

/** Flips diagonals; keep one to keep its memory from call to call. Not for two threads at once. */
class Flipper {
public:
    /** Flip diagonals in place while a flip gains; return how many flips were made.
     *
     *  triangles: three indices a triangle, all wound alike, as earcut returns them.
     *  coordinates: x and y of each of `points` points, one every `stride` numbers. Whole numbers
     *  beyond 2^53 in size count as not known: nothing beside them is flipped.
     *  Throws std::out_of_range where an index is not one of a point. */
    template <class Index, class Number>
    std::size_t operator()(Index* triangles, std::size_t length, const Number* coordinates,
                           std::size_t points, By by = By::l1, std::size_t stride = 2) {
        static_assert(std::is_integral_v<Index> && std::is_arithmetic_v<Number>);
        xy.resize(2 * points);
        for (std::size_t i = 0; i < points; i++)
            put(i, coordinates[i * stride], coordinates[i * stride + 1]);
        return flip(triangles, length, by);
    }

    /** The same for a container of indices, and the rings that earcut.hpp took: containers of
     *  points, each of them something that std::get knows (std::array, std::pair, std::tuple). */
    template <class Triangles, class Rings>
    std::size_t operator()(Triangles& triangles, const Rings& polygon, By by = By::l1) {
        std::size_t points = 0;
        for (const auto& ring : polygon) points += ring.size();
        xy.resize(2 * points);
        points = 0;
        for (const auto& ring : polygon)
            for (const auto& point : ring) put(points++, std::get<0>(point), std::get<1>(point));
        return flip(triangles.data(), triangles.size(), by);
    }

private:
    std::vector<double> xy;
    std::vector<std::uint32_t> corner;   // the point that a half-edge begins at
    std::vector<std::int32_t> twin;      // the half-edge on the other side; negative: none
    std::vector<std::int32_t> stack;     // half-edges to look at
    std::vector<std::int32_t> slots;     // half-edges by the points that they join: a hash table
    std::vector<unsigned char> waiting;  // whether a half-edge is in the stack

    struct Point {
        double x, y;
    };

    static std::uint32_t next(std::uint32_t e) { return e % 3 == 2 ? e - 2 : e + 1; }
    static std::uint32_t previous(std::uint32_t e) { return e % 3 == 0 ? e + 2 : e - 1; }
    Point at(std::uint32_t point) const { return {xy[2 * std::size_t(point)], xy[2 * std::size_t(point) + 1]}; }

    template <class Number>
    static double as_double(Number value) {
        if constexpr (std::is_integral_v<Number> && sizeof(Number) > 4) {
            constexpr auto most = Number(std::int64_t(1) << 53);
            bool known = value <= most;
            if constexpr (std::is_signed_v<Number>) known = known && value >= -most;
            if (!known) return std::numeric_limits<double>::quiet_NaN();
        }
        return static_cast<double>(value);
    }

    template <class Number>
    void put(std::size_t point, Number x, Number y) {
        xy[2 * point] = as_double(x);
        xy[2 * point + 1] = as_double(y);
    }

    template <class Index>
    std::size_t flip(Index* triangles, std::size_t length, By by) {
        const std::size_t count = length - length % 3, points = xy.size() / 2;
        if (count > std::size_t(std::numeric_limits<std::int32_t>::max()) ||
            points > std::size_t(std::numeric_limits<std::uint32_t>::max()))
            throw std::length_error("flip_triangles: more than 2^31 indices or 2^32 points");
        corner.resize(count);
        for (std::size_t e = 0; e < count; e++) {
            // A negative index is a large one.
            if (static_cast<std::make_unsigned_t<Index>>(triangles[e]) >= points)
                throw std::out_of_range("flip_triangles: an index is not one of a point");
            corner[e] = static_cast<std::uint32_t>(triangles[e]);
        }
        if (count <= 3) return 0;
        const std::size_t flips = run(by);
        if (flips)
            for (std::size_t e = 0; e < count; e++) triangles[e] = static_cast<Index>(corner[e]);
        return flips;
    }

    void push(std::uint32_t e, std::size_t& size) {
        if (twin[e] >= 0 && !waiting[e]) {
            waiting[e] = 1;
            stack[size++] = static_cast<std::int32_t>(e);
        }
    }

    std::size_t run(By by) {
        std::size_t size = link(), flips = 0;
        const double winding = by == By::delaunay ? first_turn() : 0.0;
        while (size) {
            const auto e = static_cast<std::uint32_t>(stack[--size]);
            waiting[e] = 0;
            if (twin[e] < 0) continue;
            const auto f = static_cast<std::uint32_t>(twin[e]);

            // The diagonal b-c lies between the triangles a, b, c of e and d, c, b of f.
            const std::uint32_t e1 = next(e), e2 = previous(e), f1 = next(f), f2 = previous(f);
            const Point a = at(corner[e2]), b = at(corner[e]), c = at(corner[f]), d = at(corner[f2]);
            if (!gains(by, winding, a, b, c, d) || !convex(a, b, c, d)) continue;

            flips++;
            corner[e] = corner[f2];
            corner[f] = corner[e2];
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

    // Find the twins of all half-edges, put one of each pair on the stack; return its size.
    //
    // A slot of the hash table has the last of those half-edges of an edge that wait for a twin, all in
    // one direction. While it waits, one holds -2 - the next in `twin`, the last one the first: a ring,
    // so its ends are found in one step, and any number of equal edges costs the same each.
    std::size_t link() {
        const auto count = static_cast<std::uint32_t>(corner.size());
        unsigned bits = 4;
        while ((std::size_t(1) << bits) < std::size_t(count) + count / 2) bits++;
        const std::size_t mask = (std::size_t(1) << bits) - 1;
        slots.assign(mask + 1, -1);
        twin.resize(count);
        waiting.assign(count, 0);
        stack.resize(count);
        std::size_t size = 0;
        for (std::uint32_t e = 0; e < count; e++) {
            const std::uint32_t tail = corner[e], head = corner[next(e)];
            const std::uint32_t low = tail < head ? tail : head, high = tail < head ? head : tail;
            std::size_t slot = ((low + high * 0x9e3779b1u) * 0x85ebca6bu) >> (32 - bits);
            const auto edge = static_cast<std::int32_t>(e);
            std::int32_t last;
            bool against = false;  // whether those that wait run from head to tail
            for (; (last = slots[slot]) >= 0; slot = (slot + 1) & mask) {
                const auto other = static_cast<std::uint32_t>(last);
                against = corner[other] == head && corner[next(other)] == tail;
                if (against || (corner[other] == tail && corner[next(other)] == head)) break;
            }
            if (last < 0 || twin[std::size_t(last)] >= 0) {
                slots[slot] = edge;
                twin[e] = -2 - edge;
            } else if (against) {
                const std::int32_t first = -2 - twin[std::size_t(last)];
                twin[std::size_t(last)] = twin[std::size_t(first)];
                twin[std::size_t(first)] = edge;
                twin[e] = first;
                waiting[std::size_t(first)] = 1;
                stack[size++] = first;
            } else {
                slots[slot] = edge;
                twin[e] = twin[std::size_t(last)];
                twin[std::size_t(last)] = -2 - edge;
            }
        }
        return size;
    }

    // 1 or -1, the winding of the first triangle that turns at all.
    double first_turn() const {
        FLIP_TRIANGLES_AS_WRITTEN
        for (std::size_t e = 0; e < corner.size(); e += 3) {
            const Point a = at(corner[e]), b = at(corner[e + 1]), c = at(corner[e + 2]);
            const double turn = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
            if (turn > 0.0 || turn < 0.0) return turn > 0.0 ? 1.0 : -1.0;
        }
        return 0.0;
    }

    static bool whole(double value) {
        return std::abs(value) <= 33554432.0 && value == std::floor(value);  // 2^25
    }
    static bool whole(Point a, Point b, Point c, Point d) {
        return whole(a.x) && whole(a.y) && whole(b.x) && whole(b.y) && whole(c.x) && whole(c.y) &&
               whole(d.x) && whole(d.y);
    }

    static constexpr double nothing = 1e-300;  // more than what underflow takes from a product

    // Whether the triangles a, b, d and a, d, c turn, for certain, and the same way.
    static bool convex(Point a, Point b, Point c, Point d) {
        FLIP_TRIANGLES_AS_WRITTEN
        const double x = d.x - a.x, y = d.y - a.y;
        const double p = (b.x - a.x) * y, q = (b.y - a.y) * x;
        const double r = x * (c.y - a.y), s = y * (c.x - a.x);
        const double turn = p - q, other = r - s;
        if (!(turn > 0.0 ? other > 0.0 : turn < 0.0 && other < 0.0)) return false;
        return (std::abs(turn) > 4e-16 * (std::abs(p) + std::abs(q)) + nothing &&
                std::abs(other) > 4e-16 * (std::abs(r) + std::abs(s)) + nothing) ||
               whole(a, b, c, d);
    }

    static bool gains(By by, double winding, Point a, Point b, Point c, Point d) {
        FLIP_TRIANGLES_AS_WRITTEN
        if (by == By::delaunay) return in_circle(winding, a, b, c, d);
        const double x = d.x - a.x, y = d.y - a.y, u = c.x - b.x, v = c.y - b.y;
        if (by == By::l1) return std::abs(x) + std::abs(y) < std::abs(u) + std::abs(v);
        return x * x + y * y < u * u + v * v;
    }

    // Whether d lies inside the circle through a, b, c, for certain; they turn left if winding > 0.
    static bool in_circle(double winding, Point a, Point b, Point c, Point d) {
        FLIP_TRIANGLES_AS_WRITTEN
        constexpr double exact = 1.6e8;  // up to this size, whole numbers give an exact result
        const double px = a.x - d.x, py = a.y - d.y, qx = b.x - d.x, qy = b.y - d.y;
        const double rx = c.x - d.x, ry = c.y - d.y;
        const double p = px * px + py * py, q = qx * qx + qy * qy, r = rx * rx + ry * ry;
        const double i = qx * ry - qy * rx, j = rx * py - ry * px, k = px * qy - py * qx;
        const double inside = (p * i + q * j + r * k) * winding, size = p + q + r;
        if (std::abs(inside) > 1e-15 * size * size + nothing) return inside > 0.0;
        if ((size <= exact && inside == 0.0) || !whole(a, b, c, d)) return false;
        if (size <= exact) return inside > 0.0;
        return sign_of_products(p, i, q, j, r, k) * winding > 0.0;
    }

    // The sign of p i + q j + r k, whole numbers up to 2^53 in size, in pieces of 27 bits.
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
        // What is left below is smaller than one of what is above, whatever its sign.
        const std::int64_t first = high ? high : middle ? middle : low;
        return first > 0 ? 1.0 : first < 0 ? -1.0 : 0.0;
    }
};

/** `Flipper` for one call: `flip(indices, length, coordinates, points[, by[, stride]])` or
 *  `flip(indices, polygon[, by])`. */
template <class Triangles, class... Rest>
std::size_t flip(Triangles&& triangles, Rest&&... rest) {
    return Flipper()(std::forward<Triangles>(triangles), std::forward<Rest>(rest)...);
}

}  // namespace flip_triangles

#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC pop_options
#endif
#undef FLIP_TRIANGLES_AS_WRITTEN
