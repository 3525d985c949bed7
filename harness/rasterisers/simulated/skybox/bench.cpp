// Drives Skybox's raster slice cycle by cycle: draws in on standard input, counts out on standard
// output, both as 32-bit integers in the machine's order of bytes.
//
// In:   pairs, triangles, draws, shader, fetch, x_min, x_end, y_min, y_end, whether quads are wanted
//       edges    triangles x 9   a, b, c of three edges, c at pixel (0, 0); see edges.py
//       ends     draws           how many pairs there are up to the end of each draw
//       pairs    pairs x 3       a triangle and the lower left pixel of a tile that may meet it
// Out:  counts   triangles x 6   nodes, blocks, beats, quads, partial quads, fragments
//       cycles   draws x 2       low and high half of each draw's cycles
//       quads    n, then n x 2   triangle, and {y / 2, x / 2, mask}, in the order of their coming
//
// A triangle's name on its way through the slice is the number of its pair, as far as it fits into
// 16 bits. The slice keeps the order, and far fewer than 65,536 pairs are in it at a time, so the
// pair that a name stands for is the last one of that name that went in.
//
// The shader behind the slice takes `shader` sixteenths of a cycle for each quad. It holds what is
// left of its work, and takes the next beat when less than a cycle of it is left: so a beat never
// waits for a fraction of a cycle, and over many beats the rate is exact. `fetch` is the least
// number of cycles from one pair to the next, as set-up or memory would space them.
//
// A draw begins with the cycle in which its first pair is offered and ends with the last in which
// something is in the slice or is being shaded. Buffers within the slice can hold something for a
// cycle that no signal tells of; it is taken to be empty after QUIET cycles without any.

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <vector>

#include "Vtop.h"
#include "verilated.h"

namespace {

constexpr int32_t CYCLE = 16;           // of the shader's work
constexpr int64_t QUIET = 16;           // cycles
constexpr int64_t HUNG = 1'000'000;     // cycles without anything coming or going
constexpr int QUADS = sizeof(Vtop::out_quads) / sizeof(uint32_t);

enum Count { NODES, BLOCKS, BEATS, COVERED_QUADS, PARTIAL_QUADS, FRAGMENTS, COUNTS };

struct Pair {
    int32_t triangle, x, y;
};

[[noreturn]] void fail(const char* what) {
    std::fprintf(stderr, "skybox: %s\n", what);
    std::exit(1);
}

template <typename T>
std::vector<T> read(size_t number) {
    std::vector<T> values(number);
    if (std::fread(values.data(), sizeof(T), number, stdin) != number) fail("the input ends early");
    return values;
}

template <typename T>
void write(const std::vector<T>& values) {
    if (std::fwrite(values.data(), sizeof(T), values.size(), stdout) != values.size())
        fail("the output cannot be written");
}

class Bench {
  public:
    std::vector<int32_t> counts, quads;

    explicit Bench(const std::vector<int32_t>& settings)
        : counts(static_cast<size_t>(settings[1]) * COUNTS),
          shader_(settings[3]),
          fetch_(settings[4]),
          keep_quads_(settings[9] != 0) {
        slice_.x_min = settings[5];
        slice_.x_end = settings[6];
        slice_.y_min = settings[7];
        slice_.y_end = settings[8];
        slice_.reset = 1;
        for (int k = 0; k < 8; ++k) settle(), tick();
        slice_.reset = 0;
    }

    // Draw pairs [next, end) and return the cycles until the last of them is shaded.
    int64_t draw(const std::vector<Pair>& pairs, int64_t next, int64_t end,
                 const std::vector<int32_t>& edges) {
        int64_t cycle = 0, last = 0, moved = 0, wait = 0;
        for (; next < end || cycle - last <= QUIET; ++cycle) {
            if (cycle - moved > HUNG) fail("the slice hangs");
            slice_.in_valid = next < end && wait <= 0;
            if (slice_.in_valid) offer(pairs[next], next, edges);
            slice_.out_ready = work_ < CYCLE;
            settle();

            // What the clock's edge below will carry out is settled now.
            const bool taken = slice_.in_valid && slice_.in_ready;
            const bool given = slice_.out_valid && slice_.out_ready;
            if (slice_.node) ++count_of(pairs, slice_.node_pid, NODES);
            if (slice_.block) ++count_of(pairs, slice_.node_pid, BLOCKS);
            if (slice_.in_valid || slice_.busy || slice_.out_valid || work_ > 0) last = cycle + 1;
            work_ = std::max(0, work_ - CYCLE);
            if (given) work_ += shader_ * take(pairs);
            if (slice_.node || given || taken) moved = cycle;
            --wait;
            if (taken) {
                wait = fetch_ - 1;
                last_in_ = next++;
            }
            tick();
        }
        return last;
    }

  private:
    Vtop slice_;
    const int32_t shader_, fetch_;
    const bool keep_quads_;
    int32_t work_ = 0;      // what the shader has left, in sixteenths of a cycle
    int64_t last_in_ = -1;  // the pair that went in last

    // Half a cycle with the clock low, in which signals follow the inputs; then its rising edge.
    void settle() {
        slice_.clk = 0;
        slice_.eval();
    }

    void tick() {
        slice_.clk = 1;
        slice_.eval();
    }

    // Edges at the tile's lower left pixel: c + a x + b y. That this, and whatever the slice makes
    // of it, fits into 32 bits was seen to before.
    void offer(const Pair& pair, int64_t number, const std::vector<int32_t>& edges) {
        slice_.in_x = pair.x;
        slice_.in_y = pair.y;
        slice_.in_pid = number & 0xffff;
        const int32_t* edge = &edges[static_cast<size_t>(pair.triangle) * 9];
        for (int k = 0; k < 9; k += 3) {
            slice_.in_edges[k] = edge[k];
            slice_.in_edges[k + 1] = edge[k + 1];
            slice_.in_edges[k + 2] = static_cast<uint32_t>(
                edge[k + 2] + int64_t{edge[k]} * pair.x + int64_t{edge[k + 1]} * pair.y);
        }
    }

    int32_t triangle_of(const std::vector<Pair>& pairs, uint16_t pid) const {
        const int64_t number = last_in_ - ((last_in_ - pid) & 0xffff);
        if (number < 0) fail("a triangle came out that had not gone in");
        return pairs[number].triangle;
    }

    int32_t& count_of(const std::vector<Pair>& pairs, uint16_t pid, Count what) {
        return counts[static_cast<size_t>(triangle_of(pairs, pid)) * COUNTS + what];
    }

    // Count a beat, and return how many of its quads cover anything.
    int take(const std::vector<Pair>& pairs) {
        int covered = 0;
        for (int q = 0; q < QUADS; ++q) {
            const int mask = slice_.out_quads[q] & 15;
            if (mask == 0) continue;
            const uint16_t pid = slice_.out_pids[q];
            if (covered++ == 0) ++count_of(pairs, pid, BEATS);
            ++count_of(pairs, pid, COVERED_QUADS);
            count_of(pairs, pid, PARTIAL_QUADS) += mask != 15;
            count_of(pairs, pid, FRAGMENTS) += __builtin_popcount(mask);
            if (keep_quads_) {
                quads.push_back(triangle_of(pairs, pid));
                quads.push_back(static_cast<int32_t>(slice_.out_quads[q]));
            }
        }
        return covered;
    }
};

}  // namespace

int main(int count, char** words) {
    Verilated::commandArgs(count, words);
    const auto settings = read<int32_t>(10);
    const auto edges = read<int32_t>(static_cast<size_t>(settings[1]) * 9);
    const auto ends = read<int32_t>(settings[2]);
    const auto pairs = read<Pair>(settings[0]);
    Bench bench(settings);
    std::vector<int32_t> cycles;
    int64_t next = 0;
    for (const int32_t end : ends) {
        const int64_t taken = bench.draw(pairs, next, end, edges);
        cycles.push_back(static_cast<int32_t>(taken));
        cycles.push_back(static_cast<int32_t>(taken >> 32));
        next = end;
    }
    write(bench.counts);
    write(cycles);
    if (settings[9]) {
        write(std::vector<int32_t>{static_cast<int32_t>(bench.quads.size() / 2)});
        write(bench.quads);
    }
}
