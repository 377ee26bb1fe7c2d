#!/usr/bin/env bash
# Makes the models that come with the program: the commands and seeds that made them, in the order in which they ran.
#
#     bash scripts/train_pretrained.sh compact|dcfe|compact-wide
#
# Writes simulated sets and models into the current folder. Hours on two cores; a training that was interrupted goes on
# with `tipforce train ... --resume`. No session of the protocols in docs/results (seed 0) is among the sets.
set -euo pipefail

samples() { # FOLDER PRESET SEED SAMPLES [further options]
  tipforce simulate --as dataset --preset "$2" --seed "$3" --samples "$4" -o "$1" "${@:5}"
}

shared_sets() {
  samples A bench-2021 1000 32000 --masks
  samples C bench-2021 3000 33600 --samples-per-session 40 --masks
  samples D bench-2021 4000 40000 --samples-per-session 40 --masks
  samples F bench-2021 7000 2400 --samples-per-session 40 # for intervals
}

compact() {
  shared_sets
  samples B generalise 2000 24000 --masks
  samples E generalise 6000 48000 --samples-per-session 30 --seconds 10 --masks
  samples G generalise 8000 2400 --samples-per-session 30 --seconds 10 # for intervals
  train() { tipforce train "$@" --estimator compact --set bits=8 --set batch=64; }
  train A B C D --set epochs=20 --set validation=0.05 -o models/compact-1
  train B E D --from models/compact-1 --set epochs=10 --set rate=0.001 --set warmup_epochs=0.2 --set validation=0.04 \
    -o models/compact-2
  train B E D C --from models/compact-2 --set epochs=9 --set rate=0.001 --set warmup_epochs=0.2 --set validation=0.03 \
    -o models/compact-3
  train B E D --from models/compact-3 --set epochs=6 --set rate=0.0007 --set warmup_epochs=0.1 --set validation=0.02 \
    --calibrate F --calibrate G -o models/compact
}

dcfe() {
  shared_sets
  train() {
    tipforce train "$@" --estimator dcfe --set optimiser=adamw --set weight_decay=0.02 --set clip_norm=1.0 \
      --set schedule=cosine --set average=0.998 --set batch=32
  }
  train C D --set rate=0.001 --set warmup_epochs=0.1 --set epochs=2 --set validation=0.04 -o models/dcfe-1
  train A C D --from models/dcfe-1 --set rate=0.0006 --set warmup_epochs=0.05 --set epochs=1 --set validation=0.02 \
    --calibrate F -o models/dcfe
}

compact-wide() {
  local tissue=(
    --set world.wall.log_stiffness=true --set 'world.wall.stiffness_n_per_m=[30,500]'
    --set 'world.wall.laws=["linear","hertz","exponential"]' --set 'world.wall.loss_factors=[0.1,0.5]'
    --set 'world.motion.peak_force_n=[0.05,0.6]'
  )
  local stated=(--set world.wall.stated_within=0.05) # not at calibration: there nobody states the tissue
  local faces=(
    --set 'world.wall.faces=["flat","flat","convex"]' --set 'world.wall.face_radius_m=[15e-3,60e-3]'
  )
  local scene=(
    --set scene.base_inset_m=0 --set 'scene.variety.scale_m_per_px=[1.6e-4,2.4e-4]' --set scene.variety.margin_m=0.02
    --set 'scene.variety.sheath_m=[0,0]' --set scene.variety.fitting_share=0 --set 'scene.variety.shaft_grey=[25,75]'
    --set scene.variety.shaft_tint=0.3 --set 'scene.variety.rings=[2,4]' --set scene.variety.braid_share=0.2
    --set scene.variety.dark_tip_share=0.1 --set scene.variety.blunt_share=0.1
    --set 'scene.variety.ground_grey=[140,220]' --set scene.variety.rim_share=0.4 --set 'scene.variety.rim_m=[0,3e-3]'
    --set scene.variety.hidden_share=0.15 --set scene.variety.grey_share=0.2 --set scene.variety.mosaic_share=0.3
    --set 'scene.variety.sharpen=[0,0.6]' --set 'scene.variety.front_objects=[0,1]'
  )
  short() { samples "$@" --seconds 10 --samples-per-session 40 --masks; }
  local sets=() seed
  for seed in 21001 21002 21003; do
    short "W$seed" bench-2021 "$seed" 2400 "${tissue[@]}" "${stated[@]}"
    sets+=("W$seed")
  done
  for seed in 22001 22002 22003; do
    short "Y$seed" generalise "$seed" 2400 "${tissue[@]}" "${stated[@]}"
    sets+=("Y$seed")
  done
  for seed in {31001..31005} {31013..31017}; do
    short "W$seed" bench-2021 "$seed" 2400 "${tissue[@]}" "${stated[@]}" "${faces[@]}"
    sets+=("W$seed")
  done
  for seed in {32001..32005} {32013..32017}; do
    short "Y$seed" generalise "$seed" 2400 "${tissue[@]}" "${stated[@]}" "${faces[@]}"
    sets+=("Y$seed")
  done
  for seed in {33001..33005} {33013..33017}; do
    short "X$seed" bench-2021 "$seed" 2400 "${tissue[@]}" "${stated[@]}" "${faces[@]}" "${scene[@]}"
    sets+=("X$seed")
  done
  short CW bench-2021 25001 6400 "${tissue[@]}"
  short CX bench-2021 25002 4800 "${tissue[@]}" "${scene[@]}"
  short CY generalise 25003 2400 "${tissue[@]}" "${faces[@]}"
  tipforce train "${sets[@]}" --estimator compact --from pretrained/compact --set epochs=8 --set rate=0.001 \
    --set validation=0.04 --set bits=8 --set batch=64 --set max_error_n=0.05 --calibrate CW --calibrate CX \
    --calibrate CY -o models/compact-wide
}

"${1:?state a model: compact, dcfe or compact-wide}"
