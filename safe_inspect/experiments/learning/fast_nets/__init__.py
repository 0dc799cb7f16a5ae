"""Passes through small tanh nets and steps of Adam in arrays that are made once, without autograd, on the processor.

They serve one kind of net alone: float32 layers with tanh between them. They are here because a whole training at the
shipped settings (nets of 256 and 256 units, minibatches of 500) takes 1.3 to 1.4 times the time without them, and 1.46
times that of the processors; see `benchmarks/learner_ablation.py`. Everything else, GPUs included, learns by autograd
and Torch's fused Adam on the same batches. Nothing outside `ppo_nets` and `sampling.policy_net` knows of this folder.
"""
