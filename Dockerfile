# uav_collect ready to fly over ROS 2:
#   docker build -t uav_collect .
#   mkdir -p runs && docker run --rm --user "$(id -u)" -v "$PWD/runs:/uav_collect/runs" uav_collect mission
# Without a command it lists what there is. "--target tools" is what builds it, for development.

FROM python:3.12-slim-bookworm AS tools
# Debian keeps no old versions to pin.
# hadolint ignore=DL3008
RUN apt-get update \
    && apt-get install -y --no-install-recommends chromium g++ git make \
    && rm -rf /var/lib/apt/lists/*

FROM tools AS built
WORKDIR /uav_collect
# What changes seldom comes first: packages are fetched anew only when their pins change.
COPY Makefile ./
COPY requirements requirements
COPY tools tools
RUN make .venv/.installed-wheels
COPY . .
RUN make setup && .venv/bin/python -m compileall -q uav_collect

# The compiler is left behind; Python and what it has built stay at their paths.
FROM python:3.12-slim-bookworm
COPY --from=built /uav_collect /uav_collect
# Whoever runs it, under whatever number, can write here.
RUN useradd --uid 1000 pilot && mkdir -p /uav_collect/runs && chmod 1777 /uav_collect/runs
ENV HOME=/tmp
USER 1000
WORKDIR /uav_collect
ENTRYPOINT ["/uav_collect/tools/in_ros.sh"]
CMD ["list"]
